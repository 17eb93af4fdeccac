"""All checks of the machine, in the order in which they are reported."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from ...core.errors import StorageError
from ...core.schema.options import check_options
from .checks import Finding
from .hardware import BOARD_USE, CAMERA_USE, check_boards, check_cameras
from .libraries import check_libraries, check_python
from .machine import (
    PRINTING_USE,
    check_cad,
    check_gamepad,
    check_graphics,
    check_machine,
    check_midi,
    check_slicers,
    check_solver,
)

#: Uses of the checks that only some users need.
_USES = {"cameras": CAMERA_USE, "read-out boards": BOARD_USE, "slicers": PRINTING_USE}


@dataclass(frozen=True)
class DoctorOptions:
    """Options of the checks of a machine.

    Attributes:
        pictures: Write a picture from each camera to this folder.
        port: Test these ports too, if the system does not list them (udp://HOST for Wi-Fi).
        timeout: Set the time limit of a single check in s.
    """

    pictures: Path | None = None
    port: tuple[str, ...] = ()
    timeout: Annotated[float, Meta(ge=0.1, le=3600)] = 60.0

    def __post_init__(self) -> None:
        check_options(self)


DEFAULT_OPTIONS = DoctorOptions()


def examine(options: DoctorOptions = DEFAULT_OPTIONS) -> Iterator[Finding]:
    """Check the machine.

    Args:
        options: Time limit, ports, and the folder for pictures of cameras.

    Yields:
        The findings, as soon as they are available.

    Raises:
        StorageError: The folder for pictures cannot be created (`folder-not-writable`).
    """
    seconds, pictures = options.timeout, options.pictures
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
        "read-out boards": lambda: check_boards(seconds, options.port),
        "slicers": lambda: [check_slicers()],
        "machine": lambda: check_machine(seconds),
        "gamepad": lambda: [check_gamepad(seconds)],
        "MIDI": lambda: [check_midi(seconds)],
    }
    for about, check in checks.items():
        try:
            yield from list(check())
        except OSError as error:  # a camera that was just unplugged, a folder without access
            message = f"could not be checked ({error})"
            yield Finding("system", about, False, message, needed_for=_USES.get(about, ""))
