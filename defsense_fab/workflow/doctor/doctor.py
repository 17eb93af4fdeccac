"""All checks, in the order in which they are told."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from ...core.errors import StorageError
from .boards import check_boards
from .cameras import check_cameras
from .finding import Finding, judged
from .kernels import check_cad, check_graphics, check_solver
from .libraries import check_libraries, check_python
from .machine import check_machine
from .programs import check_gamepad, check_midi, check_slicers

#: s that a single check may last.
LIMIT = 60.0
#: Checks of what not everybody needs, and for what it is needed; the others are of the core.
_BESIDES = {
    "cameras": "recording a device with cameras",
    "read-out boards": "reading the cords of a device",
    "slicers": "printing the parts here",
    "gamepad": "--output gamepad",
    "MIDI": "--output midi",
}


def examine(
    seconds: float = LIMIT, pictures: Path | None = None, ports: Sequence[str] = ()
) -> Iterator[Finding]:
    """Findings as they come; a check may last so many seconds. A picture of each camera goes into
    the folder `pictures`; `ports` are asked besides those that the system lists. Raises
    StorageError where the folder cannot be made."""
    if pictures is not None:
        try:
            pictures.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(f"--pictures {pictures}: {error.strerror}; give a folder") from None
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
        except OSError as error:  # a camera that is unplugged just then, a folder not to be seen
            told = f"could not be looked at ({error})"
            yield judged("system", about, False, told, needed_for=_BESIDES.get(about, ""))
