"""Measure the response of the cord on a specimen, and use it in the device."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import CalibrationError
from ...workflow.calibrate.record_specimen import record_specimen
from ...workflow.calibrate.simulated_specimens import simulate_specimens
from ..edits.body import use_response
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench
from .guided_task import GuidedTask
from .panel_job import PanelJob
from .result_texts import response_text
from .specimens import RESPONSE_FILE, SIMULATED_PREFIX
from .specimens import specimen_sessions as specimen_sessions

if TYPE_CHECKING:
    from ...workflow.calibrate.fit_response import FittedResponse


class CalibrationPart:
    """Folder of the panel that measures specimens on a thread and fits responses in a process.

    Args:
        bench: The workbench.

    Attributes:
        folder: Folder of the panel that holds the controls.
        status: What the measurement or the job does.
        job: Simulates specimens and fits the response.
        measurement: Measures a specimen.
        fit_result: The last fit, or None.
        is_fit_simulated: Whether it was fitted to simulated specimens.
    """

    folder: Any

    def __init__(self, bench: Workbench) -> None:
        self._bench, self.status = bench, StatusText()
        self.job = PanelJob(bench, self.status)
        self.measurement = GuidedTask(bench, "measurement", self.status, self._follow)
        self.fit_result: FittedResponse | None = None
        self.is_fit_simulated = False

    @property
    def can_use_response(self) -> bool:
        """Whether the button that uses the response is visible."""
        return bool(self._use.visible)

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
            self.job.add_panel()
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
        self.measurement.start(self._measure)

    def simulate(self) -> None:
        """Simulate sessions on specimens of the device's cord."""
        project = self._bench.project
        task = partial(
            simulate_specimens,
            project.folder,
            response=project.device.cord.response,
            prefix=SIMULATED_PREFIX,
        )
        self.job.start(task, self._show_simulated)

    def fit(self) -> None:
        """Fit the response to the specimens of the folder, and write it next to device.toml.

        Simulated specimens are used only if no specimen was measured.
        """
        from ...workflow.calibrate.fit_response import fit_response

        folder = self._bench.project.folder
        every = specimen_sessions(folder)
        measured = [p for p in every if not p.name.startswith(SIMULATED_PREFIX)]
        used = measured or every
        if not used:
            self.status.show_problem(
                "No specimen was measured yet. Measure or simulate specimens first.",
                "no-specimen",
            )
            return
        self._use.visible = False
        self.is_fit_simulated = not measured
        self.job.start(partial(fit_response, used, folder / RESPONSE_FILE), self._show_fit)

    def use(self) -> None:
        """Replace the device's response by the fitted one."""
        if self._bench.apply(use_response(RESPONSE_FILE)):
            self.status.show(
                "The device uses the measured response. Optimize the cords and build it again.",
                "response-used",
            )
            self._use.visible = False

    def close(self) -> None:
        """Stop the measurement, which can be continued later, and the job."""
        self.measurement.close()
        self.job.close()

    def _follow(self, is_busy: bool) -> None:
        self._start.disabled = is_busy

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
        port = self._port.value.strip()
        task = self.measurement
        result = record_specimen(port, path, screen=task.open_screen(self.folder))
        task.finished_steps, task.step_count = result.finished, result.readings
        if result.finished < result.readings:
            self.status.show(
                f"{result.finished} of {result.readings} readings are done. Press *Measure a"
                " specimen* to continue, or *Fit the response* to use the finished readings.",
                "measurement-incomplete",
            )
        else:
            self.status.show(
                "All readings are done. Press *Fit the response*.", "measurement-complete"
            )

    def _show_simulated(self, sessions: list[Path]) -> None:
        listed = ", ".join(f"`{session.name}`" for session in sessions)
        self.status.show(f"Simulated {listed}. Press *Fit the response*.", "specimens-simulated")

    def _show_fit(self, result: FittedResponse) -> None:
        self.fit_result = result
        self._use.visible = True
        assert result.page is not None
        text = response_text(result.data, result.page)
        if self.is_fit_simulated:
            text = (
                "**Fitted to simulated specimens. The result does not describe a real cord.**\n\n"
                + text
            )
        self.status.show(text, "response-fitted")
