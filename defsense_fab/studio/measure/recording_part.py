"""Record the finished device with its read-out board and cameras, step by step."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ...capture.sessions import session as sessions
from ...core.markers import read_markers
from ...core.storage.file_names import name_problem
from ...core.storage.files import unused_path
from ...twin.filming.camera_kinds import DEFAULT_CAMERA_KIND
from ...twin.live.capture_setup import NONE, TWIN, CaptureOptions, set_up_capture
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench
from .recording_screen import RecordingScreen
from .result_texts import StatusText

_CLOSE_TIMEOUT_S = 10.0  # time in which a recording has to end
_TWIN_CAMERAS = (1, 2, DEFAULT_CAMERA_KIND)  # seed, number and kind


class RecordingPart:
    """Folder of the panel that records the device, one recording at a time, on a thread.

    Args:
        bench: The workbench.
        on_end: Called once a recording has ended.

    Attributes:
        folder: Folder of the panel that holds the controls.
        status: What the recording does.
        screen: The screen of the running recording, or None.
        finished_steps: Number of finished steps of the last recording.
        step_count: Number of its steps.
    """

    folder: Any
    status: StatusText

    def __init__(self, bench: Workbench, on_end: Callable[[], None]) -> None:
        self._bench, self._on_end = bench, on_end
        self.worker = LatestWorker[Callable[[], None]](lambda work: work(), bench.show_error)
        self.screen: RecordingScreen | None = None
        self.finished_steps = self.step_count = 0

    @property
    def busy(self) -> bool:
        """Whether a recording is prepared, runs or ends."""
        return self.worker.busy

    @property
    def shows_options(self) -> bool:
        """Whether the options of the next recording are visible."""
        return bool(self._options_folder.visible)

    def wait(self, timeout_s: float) -> bool:
        """Wait until no recording runs; return False after `timeout_s`."""
        return self.worker.wait(timeout_s)

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
            self.status = StatusText(gui)

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
            "cameras.toml",
            hint="Enter the cameras' calibration file in the device's folder",
        )
        self._name = gui.add_text(
            "Session",
            "session",
            hint="Enter the folder of the session. A stopped session is continued",
        )
        self._rounds = gui.add_number(
            "Rounds", 2, min=1, max=100, step=1, hint="Set the number of rounds through all poses"
        )
        self._seconds = gui.add_number(
            "Time per pose (s)",
            8.0,
            min=1.0,
            max=600.0,
            step=0.5,
            hint="Set the time for each pose",
        )

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
        if self.busy:
            self.status.show("A recording is running. Stop it first.", "busy")
            return
        name = self._name.value.strip()
        is_folder_name = name not in ("", "..") and Path(name).name == name
        problem = name_problem(name) if is_folder_name else "not a folder name"
        if problem:
            self.status.show_problem(
                f"Session: {problem}. Enter the name of a folder in the device's folder.",
                "invalid-session-name",
            )
            return
        options, folder = self._options(), self._bench.project.folder / name
        self._start.disabled, self._options_folder.visible = True, False
        self.status.show("Preparing ...")
        self.worker.give(lambda: self._run(folder, options))

    def close(self) -> None:
        """Stop the recording, which can be continued later."""
        if self.screen is not None:
            self.screen.press("q")
        self.worker.wait(_CLOSE_TIMEOUT_S)
        self.worker.close()

    def _options(self) -> CaptureOptions:
        cameras = tuple(self._cameras.value.replace(",", " ").split()) or (NONE,)
        path = self._bench.project.folder / self._calibration.value.strip()
        is_simulated = cameras == (TWIN,)
        return CaptureOptions(
            cameras,
            self._port.value.strip() or NONE,
            None if is_simulated else path,
            _TWIN_CAMERAS if is_simulated else None,
            int(self._rounds.value),
            float(self._seconds.value),
        )

    def _run(self, folder: Path, options: CaptureOptions) -> None:
        problem: Exception | None = None
        try:
            is_complete = self._record(folder, options)
        except Exception as error:  # shown on the page: the studio continues
            problem = error
        screen, self.screen = self.screen, None
        if screen is not None:
            screen.close()
        if problem is not None:
            self.status.show_error(problem, "The recording")
        elif is_complete:
            self.status.show(
                f"`{folder.name}`: all steps are recorded. Press *Process the recordings* under"
                " *Training* to make it ready for training.",
                "recording-complete",
            )
        else:
            self.status.show(
                f"`{folder.name}`: {self.finished_steps} of {self.step_count} steps are recorded."
                " Press *Record* to continue.",
                "recording-incomplete",
            )
        self._start.disabled, self._options_folder.visible = False, True
        self._on_end()

    def _record(self, folder: Path, options: CaptureOptions) -> bool:
        """Record a session, and return whether all steps are recorded."""
        device = self._bench.project.device
        markers = read_markers(device.source / "markers")
        with ExitStack() as stack:
            setup = set_up_capture(device, markers, folder, options, stack, self._show_note)
            with self._bench.drawing_lock:
                self.screen = RecordingScreen(self._bench, self.folder, setup.session.channels)
            self.status.show("")
            is_complete = setup.record(self.screen)
        self.finished_steps = len(sessions.finished_steps(setup.session))
        self.step_count = len(setup.session.steps)
        if is_complete:
            self._name.value = unused_path(folder).name
        return is_complete

    def _show_note(self, text: str) -> None:
        self.status.show(text)
