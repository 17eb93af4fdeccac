"""The finished device recorded with its read-out board and cameras, step by step."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from ...capture.sessions import session as sessions
from ...core.errors import DefsenseError
from ...core.markers import read_markers
from ...core.storage.file_names import name_problem
from ...core.storage.files import unused_path
from ...twin.filming.camera_kinds import DEFAULT_CAMERA_KIND
from ...twin.live.capture_setup import NONE, TWIN, CaptureOptions, set_up_capture
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench
from .recording_screen import RecordingScreen

_LEAVES = 10.0  # s that a recording has to end
_TWIN_CAMERAS = (1, 2, DEFAULT_CAMERA_KIND)  # seed, number and kind


class RecordingPart:
    """A folder of the panel; one recording at a time, on a thread. `recorded` is called once it has
    ended."""

    def __init__(self, bench: Workbench, recorded: Callable[[], None]) -> None:
        self._bench, self._recorded = bench, recorded
        self.worker = LatestWorker[Callable[[], None]](lambda work: work(), bench.show_error)
        self.screen: RecordingScreen | None = None

    @property
    def busy(self) -> bool:
        """Whether a recording is prepared, runs or ends."""
        return self.worker.busy

    def wait(self, timeout_s: float) -> bool:
        """Wait until no recording runs; return False after `timeout_s`."""
        return self.worker.wait(timeout_s)

    def add_panel(self) -> None:
        gui, bench = self._bench.server.gui, self._bench
        self._folder = gui.add_folder("Record the device", expand_by_default=False)
        with self._folder:
            self._asked = gui.add_folder(None)
            with self._asked:
                self._port = gui.add_text(
                    "Board", TWIN, hint="The read-out board's port: /dev/ttyUSB0, COM3; twin; none"
                )
                self._cameras = gui.add_text(
                    "Cameras", TWIN,
                    hint="One for each of the calibration, as in 0 2; twin; none, where another"
                    " system records the markers",
                )  # fmt: skip
                self._calibration = gui.add_text(
                    "Calibration", "cameras.toml", hint="Of the cameras, in the device's folder"
                )
                self._name = gui.add_text(
                    "Session", "session", hint="Its folder; one that was stopped is gone on with"
                )
                self._rounds = gui.add_number("Rounds", 2, min=1, max=100, step=1,
                                              hint="Through all poses")  # fmt: skip
                self._seconds = gui.add_number("Seconds", 8.0, min=1.0, max=600.0, step=0.5,
                                               hint="For each pose")  # fmt: skip
            self._start = bench.button("Record", "Guided, step by step", self.start, color="green")
            self._told = gui.add_markdown("")

    def start(self) -> None:
        """Prepare it and go through its steps, on a thread."""
        if self.busy:
            self._told.content = "A recording is under way; stop it first."
            return
        name = self._name.value.strip()
        inside = name not in ("", "..") and Path(name).name == name
        why = name_problem(name) if inside else "give the name of a folder in the device's"
        if why:
            self._told.content = f"**Session: {why}.**"
            return
        options, folder = self._options(), self._bench.project.folder / name
        self._start.disabled, self._asked.visible = True, False
        self._told.content = "Preparing ..."
        self.worker.give(lambda: self._go(folder, options))

    def close(self) -> None:
        """What was recorded stays, and can be gone on with."""
        if self.screen is not None:
            self.screen.press("q")
        self.worker.wait(_LEAVES)
        self.worker.close()

    def _options(self) -> CaptureOptions:
        words = tuple(self._cameras.value.replace(",", " ").split()) or (NONE,)
        path = self._bench.project.folder / self._calibration.value.strip()
        simulated = words == (TWIN,)
        return CaptureOptions(
            words, self._port.value.strip() or NONE, None if simulated else path,
            _TWIN_CAMERAS if simulated else None, int(self._rounds.value),
            float(self._seconds.value),
        )  # fmt: skip

    def _go(self, folder: Path, options: CaptureOptions) -> None:
        try:
            told = self._record(folder, options)
        except DefsenseError as error:
            told = f"**{error}**"
        except Exception as error:  # told on the page: the studio goes on
            told = f"**The recording failed ({type(error).__name__}: {error}).**"
        screen, self.screen = self.screen, None
        if screen is not None:
            screen.close()
        self._told.content = told
        self._start.disabled, self._asked.visible = False, True
        self._recorded()

    def _record(self, folder: Path, options: CaptureOptions) -> str:
        device = self._bench.project.device
        markers = read_markers(device.source / "markers")
        with ExitStack() as stack:
            setup = set_up_capture(device, markers, folder, options, stack, self._note)
            with self._bench.drawing_lock:
                self.screen = RecordingScreen(self._bench, self._folder, setup.session.channels)
            self._told.content = ""
            done = setup.record(self.screen)
        steps = len(sessions.finished_steps(setup.session)), len(setup.session.steps)
        if done:
            self._name.value = unused_path(folder).name
            return (
                f"`{folder.name}`: all steps were shown. Under *Training*, *Process the recordings*"
                " makes a session of it that can be trained on."
            )
        return (
            f"`{folder.name}`: {steps[0]} of {steps[1]} steps were shown; *Record* goes on with it."
        )

    def _note(self, told: str) -> None:
        self._told.content = told
