"""The body as the device says it now, made beside the page, while the build stays as it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...core.device.device import Device
from ...core.device.device_file import load_device
from ...core.errors import DefsenseError
from ...core.mesh import Surface
from ...store.body import load_surface
from ..project.history import FOLDER
from ..workbench.beside import BesideWork, Teller


def preview_folder(folder: Path) -> Path:
    """Where a device's last preview is."""
    return folder / FOLDER / "preview"


def body_of(device: Device) -> tuple[object, ...]:
    """What the body is made from: another one is another body."""
    spec = device.body
    bay = None if spec.bay is None else (tuple(spec.bay.at), spec.bay.size)
    parameters = tuple(sorted(spec.parameters.items()))
    return (spec.kind, spec.path, parameters, spec.scale, bay, spec.fill_cavities)


class BodyPreview:
    """One at a time, always of the newest device. `told` hears of progress, `made` of the surface
    and `failed` of what went wrong, all on a thread of this."""

    def __init__(
        self,
        told: Callable[[float, str], None],
        made: Callable[[Surface], None],
        failed: Callable[[str], None],
    ) -> None:
        self._work = BesideWork("body", told, self._ended)
        self._made, self._failed = made, failed
        self._folder: Path | None = None
        self._again = self._left = self._closed = False

    @property
    def running(self) -> bool:
        return self._work.running

    def start(self, folder: Path) -> None:
        """Of the device in a folder; what is under way is of the body before, and ends."""
        self._folder, self._left = folder, False
        if not self._work.begin(make_body, folder):
            self._again = True
            self._work.cancel()

    def cancel(self) -> None:
        """Leave it; nothing is told."""
        self._again = False
        self._left = self._work.running
        self._work.cancel()

    def close(self) -> None:
        self._closed = True
        self._again = False
        self._work.close()

    def _ended(self, problem: str | None) -> None:
        if self._closed or self._folder is None:
            return
        left, self._left = self._left, False
        if self._again:
            self._again = False
            self.start(self._folder)
        elif left:
            return
        elif problem is not None:
            self._failed(problem)
        else:
            try:
                surface = load_surface(preview_folder(self._folder))
            except (DefsenseError, OSError, ValueError, KeyError) as error:
                self._failed(f"the body cannot be read: {error}")
                return
            self._made(surface)


def make_body(teller: Teller, folder: Path) -> None:
    """In the other process."""
    from ...workflow.build.build import build_body

    def progress(stage: str, share: float, message: str) -> None:
        teller.progress(share, f"{stage}: {message}")

    build_body(load_device(folder, complete=False), preview_folder(folder), progress)
