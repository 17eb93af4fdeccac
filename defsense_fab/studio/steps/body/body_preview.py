"""A preview of the body that the device describes now, made without a build."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ....core.device.device import Device
from ....core.device.device_file import load_device
from ....core.errors import BodyError, DefsenseError
from ....core.mesh import Surface
from ....workflow.build.results import Build
from ...background.background_job import BackgroundJob, JobReporter
from ...project.history import FOLDER


def preview_folder(folder: Path) -> Path:
    """Return the folder that holds the last preview of the device in `folder`."""
    return folder / FOLDER / "preview"


def body_key(device: Device) -> tuple[object, ...]:
    """Return all settings that the body is made from; equal keys mean equal bodies."""
    spec = device.body
    bay = None if spec.bay is None else (tuple(spec.bay.at), spec.bay.size)
    parameters = tuple(sorted(spec.parameters.items()))
    return (spec.kind, spec.path, parameters, spec.scale, bay, spec.fill_cavities)


class BodyPreview:
    """Make one preview at a time, always of the latest device.

    The callbacks are called on a thread of the job.

    Args:
        on_progress: Called with the completed share (0 to 1) and a message.
        on_surface: Called with the body's surface.
        on_error: Called with the error of a preview that failed.
    """

    def __init__(
        self,
        on_progress: Callable[[float, str], None],
        on_surface: Callable[[Surface], None],
        on_error: Callable[[DefsenseError], None],
    ) -> None:
        self.job = BackgroundJob("body", on_progress, self.finish)
        self.on_surface, self.on_error = on_surface, on_error
        self._folder: Path | None = None
        self._should_restart = self._is_cancelled = self._is_closed = False

    @property
    def is_running(self) -> bool:
        """Whether a preview is being made."""
        return self.job.is_running

    def start(self, folder: Path) -> None:
        """Make a preview of the device in `folder`; cancel a preview of an earlier device."""
        self._folder, self._is_cancelled = folder, False
        if not self.job.start(make_body, folder):
            self._should_restart = True
            self.job.cancel()

    def cancel(self) -> None:
        """Stop the preview without calling `on_error`."""
        self._should_restart = False
        self._is_cancelled = self.job.is_running
        self.job.cancel()

    def wait(self, timeout_s: float) -> bool:
        """Wait until no preview is being made; return False after `timeout_s`."""
        return self.job.wait(timeout_s)

    def close(self) -> None:
        """Stop the preview and wait for its process."""
        self._is_closed = True
        self._should_restart = False
        self.job.close()

    def finish(self, error: DefsenseError | None, _: object = None) -> None:
        """Handle the end of the job: load the surface, report the error, or start again."""
        if self._is_closed or self._folder is None:
            return
        was_cancelled, self._is_cancelled = self._is_cancelled, False
        if self._should_restart:
            self._should_restart = False
            self.start(self._folder)
        elif was_cancelled:
            return
        elif error is not None:
            self.on_error(error)
        else:
            self._load(preview_folder(self._folder))

    def _load(self, folder: Path) -> None:
        try:
            surface = Build(folder).surface
        except (DefsenseError, OSError, ValueError, KeyError) as error:
            self.on_error(
                BodyError(f"cannot be read: {error}", code="file-unreadable", where="the body")
            )
            return
        self.on_surface(surface)


def make_body(reporter: JobReporter, folder: Path) -> None:
    """Make the body of the device in `folder`; run this in a BackgroundJob."""
    from ....workflow.build.build import build_body

    device = load_device(folder, complete=False)
    build_body(device, preview_folder(folder), reporter.stage_progress)
