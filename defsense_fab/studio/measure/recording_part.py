"""Record the finished device with its read-out board and cameras, step by step."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ...core.storage.file_names import name_problem
from ...core.storage.files import unused_path
from ...workflow.sessions.options import CALIBRATION_FILE, RecordOptions
from ...workflow.sessions.recording import (
    NONE,
    SESSION_FOLDER,
    TWIN,
    RecordedSession,
    is_twin,
    record_session,
)
from ..workbench.controls import add_option
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench
from .guided_task import GuidedTask


class RecordingPart:
    """Folder of the panel that records the device, one recording at a time, on a thread.

    Args:
        bench: The workbench.
        on_end: Called once a recording has ended.

    Attributes:
        folder: Folder of the panel that holds the controls.
        status: What the recording does.
        recording: The recording.
    """

    folder: Any

    def __init__(self, bench: Workbench, on_end: Callable[[], None]) -> None:
        self._bench, self._on_end, self.status = bench, on_end, StatusText()
        self.recording = GuidedTask(bench, "recording", self.status, self._follow)

    @property
    def shows_options(self) -> bool:
        """Whether the options of the next recording are visible."""
        return bool(self._options_folder.visible)

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, bench = self._bench.server.gui, self._bench
        self.folder = gui.add_folder("Record the device", expand_by_default=False)
        with self.folder:
            self._options_folder = gui.add_folder(None)
            with self._options_folder:
                self._add_options()
            self._start = bench.button(
                "Record", "Record the device step by step", self.start, color="green"
            )
            self.status.add_panel(gui)

    def _add_options(self) -> None:
        gui = self._bench.server.gui
        self._port = gui.add_text(
            "Board",
            TWIN,
            hint="Enter the port of the read-out board, such as /dev/ttyUSB0 or COM3; or twin; or"
            " none",
        )
        self._cameras = gui.add_text(
            "Cameras",
            TWIN,
            hint="Enter a camera for each one of the calibration, such as 0 2; or twin; or none if"
            " another system records the markers",
        )
        self._calibration = gui.add_text(
            "Calibration",
            str(CALIBRATION_FILE),
            hint="Enter the cameras' calibration file in the device's folder",
        )
        self._name = gui.add_text(
            "Session",
            SESSION_FOLDER,
            hint="Enter the folder of the session. A stopped session is resumed",
        )
        self._rounds = add_option(gui, RecordOptions, "rounds", "Rounds", 1)
        self._seconds = add_option(gui, RecordOptions, "seconds", "Time per pose (s)", 0.5)

    def set_options(
        self,
        *,
        port: str | None = None,
        cameras: str | None = None,
        rounds: int | None = None,
        name: str | None = None,
    ) -> None:
        """Set options of the next recording; None leaves an option unchanged."""
        for control, value in (
            (self._port, port),
            (self._cameras, cameras),
            (self._rounds, rounds),
            (self._name, name),
        ):
            if value is not None:
                control.value = value

    def start(self) -> None:
        """Prepare a recording and go through its steps, on a thread."""
        name = self._name.value.strip()
        is_folder_name = name not in ("", "..") and Path(name).name == name
        problem = name_problem(name) if is_folder_name else "not a folder name"
        if problem:
            self.status.show_problem(
                f"Session: {problem}. Enter the name of a folder in the device's folder.",
                "invalid-session-name",
            )
            return
        cameras, folder = self._camera_addresses(), self._bench.project.folder / name
        record = partial(
            record_session,
            self._bench.project.device,
            cameras,
            self._port.value.strip() or NONE,
            self._options(folder, cameras),
            open_screen=lambda _: self.recording.open_screen(self.folder),
            note=self.status.show,
        )
        self.recording.start(lambda: self._show_result(record(), folder))

    def close(self) -> None:
        """Stop the recording, which can be resumed later."""
        self.recording.close()

    def _camera_addresses(self) -> tuple[str, ...]:
        text = self._cameras.value.strip()
        addresses = text if is_twin(text) else text.replace(",", " ")
        return tuple(addresses.split()) or (NONE,)

    def _options(self, folder: Path, cameras: tuple[str, ...]) -> RecordOptions:
        calibration = self._bench.project.folder / self._calibration.value.strip()
        return RecordOptions(
            calibration=None if is_twin(cameras[0]) else calibration,
            out=folder,
            rounds=int(self._rounds.value),
            seconds=float(self._seconds.value),
        )

    def _follow(self, is_busy: bool) -> None:
        self._start.disabled, self._options_folder.visible = is_busy, not is_busy
        if not is_busy:
            self._on_end()

    def _show_result(self, result: RecordedSession, folder: Path) -> None:
        finished, count = result.finished_steps, len(result.session.steps)
        self.recording.finished_steps, self.recording.step_count = finished, count
        if result.is_complete:
            self._name.value = unused_path(folder).name
            self.status.show(
                f"`{folder.name}`: all steps are recorded. Press *Process the recordings* under"
                " *Training* to make it ready for training.",
                "recording-complete",
            )
        else:
            self.status.show(
                f"`{folder.name}`: {finished} of {count} steps are recorded."
                " Press *Record* to resume.",
                "recording-incomplete",
            )
