"""The cord's response, measured on a specimen, and the device made to use it."""

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
from .measurement_screen import response_words

_RESPONSE = "response.json"
_LEAVES = 10.0  # s that a measurement has to end


class CalibrationPart:
    """A folder of the panel; one measurement at a time, on a thread, and fits in a process."""

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self.work = BackgroundJob("work", self._progress, self._ended)
        self._told_of: Callable[[Any], str] = str
        self.worker = LatestWorker[Callable[[], None]](lambda work: work(), bench.show_error)
        self.screen: MeasurementScreen | None = None

    @property
    def busy(self) -> bool:
        """Whether a measurement is prepared, runs or ends."""
        return self.worker.busy

    def wait(self, timeout_s: float) -> bool:
        """Wait until no measurement runs; return False after `timeout_s`."""
        return self.worker.wait(timeout_s)

    def add_panel(self) -> None:
        gui, bench = self._bench.server.gui, self._bench
        self._folder = gui.add_folder("Calibrate the cord", expand_by_default=False)
        with self._folder:
            self._port = gui.add_text(
                "Board", "twin:speed=20",
                hint="The read-out board's port: /dev/ttyUSB0, COM3; twin:speed=20, simulated",
            )  # fmt: skip
            self._specimen = gui.add_text(
                "Specimen", "specimen",
                hint="What defsense calibrate specimen wrote: a folder in the device's",
            )  # fmt: skip
            self._start = bench.button(
                "Measure a specimen", "Guided, jig by jig", self.start, color="green"
            )
            bench.button(
                "Simulate specimens", "Sessions of two, without waiting, to try the fit",
                self.simulate,
            )  # fmt: skip
            bench.button("Fit the response", "To all sessions on specimens in the folder", self.fit)
            self._cancel = bench.button(
                "Cancel", "Files stay as they were", self.work.cancel, visible=False
            )
            self._told = gui.add_markdown("")
            self._use = bench.button(
                "Use it in this device", "[cord] response; can be undone", self.use, visible=False
            )

    def start(self) -> None:
        """Measure a specimen, or go on with it, on a thread."""
        if self.busy:
            self._tell("A measurement is under way; stop it first.")
            return
        self._start.disabled = True
        self._tell("Preparing ...")
        self.worker.give(self._go)

    def simulate(self) -> None:
        """Sessions of simulated specimens of the device's cord."""
        there = [p.name for p in self._bench.project.folder.glob(f"{jobs.SIMULATED}-*")]
        if there:
            self._tell(f"**`{there[0]}` is there already: fit it, or remove it first.**")
            return
        self._do(partial(jobs.simulate_specimens, self._bench.project.folder), _simulated)

    def fit(self) -> None:
        """To all sessions on specimens; beside device.toml."""
        folder = self._bench.project.folder
        every = specimen_sessions(folder)
        real = [p for p in every if not _is_simulated(p)]
        found = real or every  # what is simulated says nothing of a cord that was measured
        if not found:
            self._tell("**No specimen was measured yet: *Measure a specimen*, or simulate some.**")
            return
        self._use.visible = False
        told_of = self._fitted if real else self._fitted_to_simulated
        self._do(partial(jobs.fit, found, folder / _RESPONSE), told_of)

    def use(self) -> None:
        """The response in place of the data sheet's."""
        if self._bench.apply(use_response(_RESPONSE)):
            self._tell(
                "The device uses the measured response: *Optimise* and build it anew under *Make*."
            )
            self._use.visible = False

    def close(self) -> None:
        """What was measured stays, and can be gone on with."""
        if self.screen is not None:
            self.screen.press("q")
        self.worker.wait(_LEAVES)
        self.worker.close()
        self.work.close()

    def _go(self) -> None:
        try:
            told = self._measure()
        except DefsenseError as error:
            told = f"**{error}**"
        except Exception as error:  # told on the page: the studio goes on
            told = f"**The measurement failed ({type(error).__name__}: {error}).**"
        screen, self.screen = self.screen, None
        if screen is not None:
            screen.close()
        self._start.disabled = False
        self._tell(told)

    def _measure(self) -> str:
        home = self._bench.project.folder.resolve()
        place = (home / self._specimen.value.strip()).resolve()
        if not place.is_relative_to(home):
            raise CalibrationError(
                f"{place}: lies outside of the device's folder; copy the specimen's folder there"
            )
        about = sessions.read_specimen(place)
        folder = (place if place.is_dir() else place.parent) / "session"
        session, begun = sessions.create_or_resume(folder, sessions.default_settings(about))
        try:
            settings = ReadoutSettings(channels=3, average=session.average, rate=session.rate)
            opened = open_source(
                self._port.value.strip(), settings, session.geometry, session.length
            )
            with self._bench.drawing_lock:
                self.screen = MeasurementScreen(self._bench, self._folder)
            self._tell("")
            run_guided_measurement(session, opened.source, self.screen, opened.hands)
        except DefsenseError:
            if not begun:
                sessions.discard_empty(session)
            raise
        left, total = len(sessions.unfinished_steps(session)), len(session.steps)
        if left:
            return (
                f"{total - left} of {total} readings are done: *Measure a specimen* goes on;"
                " *Fit the response* takes what there is."
            )
        return "All readings are done: *Fit the response*."

    def _do(self, job: Any, told_of: Callable[[Any], str]) -> None:
        if self.work.running:
            self._tell("**Something is under way here; wait for it, or cancel it.**")
            return
        self._told_of, self._cancel.visible = told_of, True
        self._tell("Starting ...")
        self.work.start(run_with_progress, job)

    def _progress(self, share: float, told: str) -> None:
        self._tell(f"{told} ({share:.0%})")

    def _ended(self, error: DefsenseError | None, result: Any) -> None:
        self._cancel.visible = False
        self._tell(f"**{error}**" if error is not None else self._told_of(result))

    def _fitted(self, result: Any) -> str:
        self._use.visible = True
        return response_words(result)

    def _fitted_to_simulated(self, result: Any) -> str:
        return "**Of simulated specimens: this says nothing of a real cord.**\n\n" + self._fitted(
            result
        )

    def _tell(self, told: str) -> None:
        self._told.content = told


def _simulated(folders: list[str]) -> str:
    return f"Simulated {', '.join(f'`{name}`' for name in folders)}: *Fit the response*."


def _is_simulated(session: Path) -> bool:
    return session.name.startswith(jobs.SIMULATED)


def specimen_sessions(folder: Path) -> list[Path]:
    """Sessions on specimens in a folder, and in folders of it."""
    out = []
    for path in sorted([*folder.glob(f"*/{FILE}"), *folder.glob(f"*/*/{FILE}")]):
        try:
            said = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):  # of whatever kind it was, it tells nothing
            continue
        if isinstance(said, dict) and "specimen" in said:
            out.append(path.parent)
    return out
