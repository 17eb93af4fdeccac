"""All checks of the machine, in the order in which they are reported."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from ...core.errors import StorageError
from .checks import Finding, make_finding
from .hardware import check_boards, check_cameras
from .libraries import check_libraries, check_python
from .machine import (
    check_cad,
    check_gamepad,
    check_graphics,
    check_machine,
    check_midi,
    check_slicers,
    check_solver,
)

#: Time limit of a single check, s.
LIMIT = 60.0
#: Checks that only some users need, and their uses; the others belong to the core.
_OPTIONAL_CHECKS = {
    "cameras": "recording a device with cameras",
    "read-out boards": "reading the cords of a device",
    "slicers": "printing the parts here",
    "gamepad": "--output gamepad",
    "MIDI": "--output midi",
}


def examine(
    seconds: float = LIMIT, pictures: Path | None = None, ports: Sequence[str] = ()
) -> Iterator[Finding]:
    """Check the machine.

    Args:
        seconds: Time limit of a single check, s.
        pictures: Folder for a picture of each camera; None for no pictures.
        ports: Ports to check that the system does not list.

    Yields:
        The findings, as soon as they are known.

    Raises:
        StorageError: The folder for pictures cannot be created (`folder-not-writable`).
    """
    if pictures is not None:
        try:
            pictures.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"the folder cannot be created ({error.strerror})",
                code="folder-not-writable",
                where=pictures,
                action="Choose another folder",
            ) from None
    checks: dict[str, Callable[[], Iterable[Finding]]] = {
        "Python": lambda: [check_python()],
        "libraries": lambda: check_libraries(seconds),
        "OpenGL": lambda: [check_graphics(seconds)],
        "CAD kernels": lambda: [check_cad(seconds)],
        "solver": lambda: [check_solver(seconds)],
        "cameras": lambda: check_cameras(seconds, pictures),
        "read-out boards": lambda: check_boards(seconds, ports),
        "slicers": lambda: [check_slicers()],
        "machine": lambda: check_machine(seconds),
        "gamepad": lambda: [check_gamepad(seconds)],
        "MIDI": lambda: [check_midi(seconds)],
    }
    for about, check in checks.items():
        try:
            yield from list(check())
        except OSError as error:  # a camera that was just unplugged, a folder without access
            text, use = f"could not be checked ({error})", _OPTIONAL_CHECKS.get(about, "")
            yield make_finding("system", about, False, text, needed_for=use)
