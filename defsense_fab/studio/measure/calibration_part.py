"""Measure the response of the cord on a specimen, and use it in the device."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ...calibration import session as sessions
from ...calibration.guided_measurement import run_guided_measurement
from ...capture.readout.reader import ReadoutSettings
from ...core.errors import CalibrationError, DefsenseError
from ...core.storage.session_manifest import FILE
from ...twin.live.sample_sources import open_source
from ..edits.body import use_response
from ..workbench.background_job import BackgroundJob, run_with_progress
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench
from . import jobs
from .measurement_screen import MeasurementScreen
from .result_texts import StatusText, response_text

_RESPONSE_FILE = "response.json"
_CLOSE_TIMEOUT_S = 10.0  # time in which a measurement has to end


class CalibrationPart:
    """Folder of the panel that measures specimens on a thread and fits responses in a process.

    Args:
        bench: The workbench.

    Attributes:
        folder: Folder of the panel that holds the controls.
        status: What the measurement or the job does.
        job: Simulates specimens and fits the response.
        screen: The screen of the running measurement, or None.
        finished_steps: Number of finished readings of the last measurement.
        step_count: Number of its readings.
        fit_result: The last fit, or None.
        is_fit_simulated: Whether it was fitted to simulated specimens.
    """

    folder: Any
    status: StatusText

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self.job = BackgroundJob("job", self._show_progress, self.end_job)
        self._on_result: Callable[[Any], None] = lambda _: None
        self.worker = LatestWorker[Callable[[], None]](lambda work: work(), bench.show_error)
        self.screen: MeasurementScreen | None = None
        self.finished_steps = self.step_count = 0
        self.fit_result: jobs.FitResult | None = None
        self.is_fit_simulated = False

    @property
    def busy(self) -> bool:
        """Whether a measurement is prepared, runs or ends."""
        return self.worker.busy

    @property
    def can_use_response(self) -> bool:
        """Whether the button that uses the response is visible."""
        return bool(self._use.visible)

    def wait(self, timeout_s: float) -> bool:
        """Wait until no measurement runs; return False after `timeout_s`."""
        return self.worker.wait(timeout_s)

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, bench = self._bench.server.gui, self._bench
        self.folder = gui.add_folder("Calibrate the cord", expand_by_default=False)
        with self.folder:
            self._port = gui.add_text(
                "Board",
                "twin:speed=20",
                hint="Enter the port of the read-out board, such as /dev/ttyUSB0 or COM3; or"
                " twin:speed=20 to simulate it",
            )
            self._specimen = gui.add_text(
                "Specimen",
                "specimen",
                hint="Enter the folder that `defsense calibrate specimen` wrote",
            )
            self._start = bench.button(
                "Measure a specimen", "Measure it jig by jig", self.start, color="green"
            )
            bench.button(
                "Simulate specimens",
                "Simulate two specimens to try the fit",
                self.simulate,
            )
            bench.button(
                "Fit the response", "Fit it to all measured specimens in the folder", self.fit
            )
            self._cancel = bench.button(
                "Cancel", "Stop the job and keep all files", self.job.cancel, visible=False
            )
            self.status = StatusText(gui)
            self._use = bench.button(
                "Use the response",
                "Set [cord] response of this device. Undo restores it",
                self.use,
                visible=False,
            )

    def set_options(self, *, port: str | None = None, specimen: str | None = None) -> None:
        """Set the board's port and the specimen's folder; None leaves an option unchanged."""
        if port is not None:
            self._port.value = port
        if specimen is not None:
            self._specimen.value = specimen

    def start(self) -> None:
        """Measure a specimen, or continue its measurement, on a thread."""
        if self.busy:
            self.status.show("A measurement is running. Stop it first.", "busy")
            return
        self._start.disabled = True
        self.status.show("Preparing ...")
        self.worker.give(self._run)

    def simulate(self) -> None:
        """Simulate sessions on specimens of the device's cord."""
        folder = self._bench.project.folder
        existing = [p.name for p in folder.glob(f"{jobs.SIMULATED_PREFIX}-*")]
        if existing:
            self.status.show_problem(
                f"`{existing[0]}` exists already. Fit it, or delete it first.", "path-exists"
            )
            return
        self._start_job(partial(jobs.simulate_specimens, folder), self._show_simulated)

    def fit(self) -> None:
        """Fit the response to the specimens of the folder, and write it next to device.toml.

        Simulated specimens are used only if no specimen was measured.
        """
        folder = self._bench.project.folder
        every = specimen_sessions(folder)
        measured = [p for p in every if not p.name.startswith(jobs.SIMULATED_PREFIX)]
        used = measured or every
        if not used:
            self.status.show_problem(
                "No specimen was measured yet. Measure or simulate specimens first.",
                "no-specimen",
            )
            return
        self._use.visible = False
        self.is_fit_simulated = not measured
        self._start_job(partial(jobs.fit, used, folder / _RESPONSE_FILE), self._show_fit)

    def use(self) -> None:
        """Replace the device's response by the fitted one."""
        if self._bench.apply(use_response(_RESPONSE_FILE)):
            self.status.show(
                "The device uses the measured response. Optimize the cords and build it again.",
                "response-used",
            )
            self._use.visible = False

    def end_job(self, error: DefsenseError | None, result: Any) -> None:
        """Show the error or the result of a job that has ended."""
        self._cancel.visible = False
        if error is not None:
            self.status.show_error(error)
        else:
            self._on_result(result)

    def close(self) -> None:
        """Stop the measurement, which can be continued later, and the job."""
        if self.screen is not None:
            self.screen.press("q")
        self.worker.wait(_CLOSE_TIMEOUT_S)
        self.worker.close()
        self.job.close()

    def _run(self) -> None:
        problem: Exception | None = None
        try:
            self._measure()
        except Exception as error:  # shown on the page: the studio continues
            problem = error
        screen, self.screen = self.screen, None
        if screen is not None:
            screen.close()
        self._start.disabled = False
        if problem is not None:
            self.status.show_error(problem, "The measurement")
        elif self.finished_steps < self.step_count:
            self.status.show(
                f"{self.finished_steps} of {self.step_count} readings are done. Press *Measure a"
                " specimen* to continue, or *Fit the response* to use the finished readings.",
                "measurement-incomplete",
            )
        else:
            self.status.show(
                "All readings are done. Press *Fit the response*.", "measurement-complete"
            )

    def _measure(self) -> None:
        project_folder = self._bench.project.folder.resolve()
        path = (project_folder / self._specimen.value.strip()).resolve()
        if not path.is_relative_to(project_folder):
            raise CalibrationError(
                "is outside of the device's folder",
                code="outside-device-folder",
                where=path,
                action="Copy the specimen's folder to the device's folder",
            )
        specimen = sessions.read_specimen(path)
        folder = (path if path.is_dir() else path.parent) / "session"
        session, is_resumed = sessions.create_or_resume(folder, sessions.default_settings(specimen))
        try:
            settings = ReadoutSettings(channels=3, average=session.average, rate=session.rate)
            opened = open_source(
                self._port.value.strip(), settings, session.geometry, session.length
            )
            with self._bench.drawing_lock:
                self.screen = MeasurementScreen(self._bench, self.folder)
            self.status.show("")
            run_guided_measurement(session, opened.source, self.screen, opened.hands)
        except DefsenseError:
            if not is_resumed:
                sessions.discard_empty(session)
            raise
        self.step_count = len(session.steps)
        self.finished_steps = self.step_count - len(sessions.unfinished_steps(session))

    def _start_job(self, task: Any, on_result: Callable[[Any], None]) -> None:
        if self.job.running:
            self.status.show_problem("A job is running. Wait for it or cancel it.", "busy")
            return
        self._on_result, self._cancel.visible = on_result, True
        self.status.show("Starting ...")
        self.job.start(run_with_progress, task)

    def _show_progress(self, share: float, message: str) -> None:
        self.status.show(f"{message} ({share:.0%})")

    def _show_simulated(self, names: list[str]) -> None:
        listed = ", ".join(f"`{name}`" for name in names)
        self.status.show(f"Simulated {listed}. Press *Fit the response*.", "specimens-simulated")

    def _show_fit(self, result: jobs.FitResult) -> None:
        self.fit_result = result
        self._use.visible = True
        text = response_text(result)
        if self.is_fit_simulated:
            text = (
                "**Fitted to simulated specimens. The result does not describe a real cord.**\n\n"
                + text
            )
        self.status.show(text, "response-fitted")


def specimen_sessions(folder: Path) -> list[Path]:
    """Return the sessions on specimens in a folder and in its subfolders, sorted by path."""
    found = []
    for path in sorted([*folder.glob(f"*/{FILE}"), *folder.glob(f"*/*/{FILE}")]):
        try:
            manifest = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):  # damaged, whatever kind of session it is
            continue
        if isinstance(manifest, dict) and "specimen" in manifest:
            found.append(path.parent)
    return found
