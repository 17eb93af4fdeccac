"""Choose sessions, and train and evaluate models on them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ...core.device.device import Device
from ...workflow.run.choices import is_built
from ...workflow.sessions.known_sessions import KnownSession, known_sessions
from ...workflow.sessions.twin_sessions import session_folder
from ...workflow.train.options import TwinOptions
from ...workflow.train.training import MODEL
from ..workbench.controls import DEFAULT_CHOICE, add_option
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_texts import StatusText, bullet_list
from ..workbench.workbench import Workbench
from . import jobs
from .panel_job import PanelJob
from .result_texts import evaluation_text, relative_name, training_text

_NO_SESSION = "Choose a processed session, or record one first."


class TrainingPart:
    """Folder of the panel that trains models; one job at a time, in a child process.

    Args:
        bench: The workbench.
        on_change: Called when there is another model or session.

    Attributes:
        status: What the job does.
        job: Runs the jobs.
        result: Result of the last job, or None.
        sessions: The sessions of the device, newest last.
    """

    def __init__(self, bench: Workbench, on_change: Callable[[], None]) -> None:
        self._bench, self._on_change = bench, on_change
        self.status = StatusText()
        self.job = PanelJob(bench, self.status)
        self.result: Any = None
        self.sessions: list[KnownSession] = []
        self._search = LatestWorker(self._find_sessions, bench.status.show_error)
        self._boxes: dict[Path, Any] = {}
        self._rows: list[Any] = []  # of the sessions' folder
        self._page: Path | None = None  # of the evaluation

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, bench = self._bench.server.gui, self._bench
        with gui.add_folder("Training", expand_by_default=False):
            self._folder = gui.add_folder("Sessions")
            with gui.add_folder("Record the simulated twin", expand_by_default=False):
                self._add_twin_controls()
            self._process = bench.button(
                "Process the recordings",
                "Process the sessions that are not processed yet",
                self.process,
                visible=False,
            )
            bench.button("Train", f"Train {MODEL} on the chosen sessions", self.train)
            bench.button("Evaluate", f"Test {MODEL} on images it was not trained on", self.evaluate)
            bench.button(
                "Train on the simulation",
                f"Train {MODEL} without any session",
                self.train_on_simulation,
            )
            self.job.add_panel()
            self._result = gui.add_markdown("")
            self._download = gui.add_button(
                "Download the evaluation", hint="Save its report as a file", visible=False
            )
            self._download.on_click(lambda event: self.send_page(event.client))

    def _add_twin_controls(self) -> None:
        gui = self._bench.server.gui
        self._minutes = add_option(gui, TwinOptions, "minutes", "Duration (min)", 0.1)
        self._unit = add_option(gui, TwinOptions, "unit", "Unit", 1)
        self._seed = add_option(gui, TwinOptions, "seed", "Seed", 1)
        self._cords = add_option(gui, TwinOptions, "cords", "Cords", 1)
        self._bench.button(
            "Record the twin", "Simulate a session, as `defsense twin` does", self.record_twin
        )

    @property
    def chosen(self) -> list[Path]:
        """Folders of the chosen sessions."""
        return [folder for folder, box in self._boxes.items() if box.value]

    @property
    def offered(self) -> list[Path]:
        """Folders of the sessions that can be chosen."""
        return list(self._boxes)

    @property
    def can_process(self) -> bool:
        """Whether the button that processes recordings is visible."""
        return bool(self._process.visible)

    @property
    def can_download(self) -> bool:
        """Whether the button that downloads the evaluation is visible."""
        return bool(self._download.visible)

    @property
    def twin_seed(self) -> int:
        """Seed of the next simulated session."""
        return int(self._seed.value)

    def choose(self, folders: list[Path]) -> None:
        """Choose these sessions and no others."""
        for folder, box in self._boxes.items():
            box.value = folder in folders

    def set_twin(self, *, minutes: float | None = None, seed: int | None = None) -> None:
        """Set the duration and the seed of the next simulated session; None changes nothing."""
        if minutes is not None:
            self._minutes.value = minutes
        if seed is not None:
            self._seed.value = seed

    def refresh(self) -> None:
        """Search for sessions on a thread."""
        self._search.give(self._bench.project.device)

    def wait_for_sessions(self, timeout_s: float) -> bool:
        """Wait until the search has ended; return False after `timeout_s`."""
        return self._search.wait(timeout_s)

    def record_twin(self) -> None:
        """Record a session of the device's simulated twin."""
        device = self._bench.project.device
        if not is_built(device):
            self.status.show_problem(
                "The device is not built yet. Build it in *Make*.", "not-built"
            )
            return
        unit, seed = int(self._unit.value), int(self._seed.value)
        out = session_folder(device, unit, seed)
        if out.exists():
            self.status.show_problem(
                f"`{out.name}` exists already. Choose another seed or unit.", "file-exists"
            )
            return
        cords = None if self._cords.value == DEFAULT_CHOICE else self._cords.value
        options = TwinOptions(minutes=float(self._minutes.value), unit=unit, seed=seed, cords=cords)
        task = partial(jobs.record_twin, device.source, options)
        self._start_job(task, self._recording_text)

    def process(self) -> None:
        """Process the recorded sessions that are not processed yet."""
        raw = [s.folder for s in self.sessions if s.is_raw]
        if raw:
            self._start_job(partial(jobs.process, raw), bullet_list)

    def train(self) -> None:
        """Train a model on the chosen sessions; cross-validation decides the simulation's part."""
        if not self.chosen:
            self.status.show_problem(_NO_SESSION, "no-session-chosen")
            return
        task = partial(jobs.train, self._bench.project.folder, self.chosen)
        self._start_job(task, training_text)

    def train_on_simulation(self) -> None:
        """Train a model on the simulated states alone."""
        self._start_job(partial(jobs.train, self._bench.project.folder, []), training_text)

    def evaluate(self) -> None:
        """Evaluate the folder's model on the chosen sessions."""
        folder = self._bench.project.folder
        if not (folder / MODEL).exists():
            self.status.show_problem(f"No `{MODEL}` yet. Train a model first.", "no-model")
            return
        if not self.chosen:
            self.status.show_problem(_NO_SESSION, "no-session-chosen")
            return
        task = partial(jobs.evaluate, folder, folder / MODEL, self.chosen)
        self._start_job(task, self._evaluation_text)

    def send_page(self, client: Any) -> None:
        """Send the report of the evaluation to a browser."""
        if client is None or self._page is None:
            return
        try:
            content = self._page.read_bytes()
        except OSError as error:
            self.status.show_problem(
                f"{self._page}: cannot be read ({error.strerror}). Evaluate again.",
                "file-unreadable",
            )
            return
        client.send_file_download(self._page.name, content)

    def close(self) -> None:
        """End the job and the threads."""
        self.job.close()
        self._search.close()

    def _start_job(self, task: Callable[..., Any], result_text: Callable[[Any], str]) -> None:
        self.result = None
        self._result.content, self._download.visible = "", False
        self.job.start(task, lambda result: self._show_result(result, result_text(result)))

    def _show_result(self, result: Any, text: str) -> None:
        self.result, self._result.content = result, text
        self.refresh()
        self._on_change()

    def _recording_text(self, folders: list[str]) -> str:
        names = ", ".join(f"`{relative_name(f, self._bench.project.folder)}`" for f in folders)
        self._offer_free_seed(self._bench.project.device)
        return f"Recorded {names}. Press *Train* to train on it."

    def _evaluation_text(self, result: jobs.EvaluationResult) -> str:
        self._page = Path(result.page)
        self._download.visible = True
        return evaluation_text(result)

    def _offer_free_seed(self, device: Device) -> None:
        """Set the seed to the next one without a session."""
        seed = int(self._seed.value)
        while session_folder(device, int(self._unit.value), seed).exists():
            seed += 1
        self._seed.value = seed

    def _find_sessions(self, device: Device) -> None:
        sessions = known_sessions(device)
        with self._bench.drawing_lock:
            if sessions == self.sessions and self._rows:
                return
            self._offer_free_seed(device)
            self._process.visible = any(s.is_raw for s in sessions)
            was_chosen = {folder: box.value for folder, box in self._boxes.items()}
            for row in self._rows:
                row.remove()
            self.sessions, self._boxes, self._rows = sessions, {}, []
            with self._folder:
                self._list_sessions(sessions, was_chosen, device)

    def _list_sessions(
        self, sessions: list[KnownSession], was_chosen: dict[Path, bool], device: Device
    ) -> None:
        gui = self._bench.server.gui
        usable = [s for s in sessions if s.is_usable]
        for session in usable:
            is_newest = session is usable[-1]  # the user most likely wants to train on it
            box = gui.add_checkbox(
                relative_name(session.folder, device.source),
                was_chosen.get(session.folder, is_newest),
                hint=session.summary,
            )
            self._boxes[session.folder] = box
            self._rows.append(box)
        text = bullet_list(
            [
                f"`{relative_name(s.folder, device.source)}` {s.problem}"
                for s in sessions
                if not s.is_usable
            ]
        )
        if not sessions:
            text = "No sessions yet. Record the twin here, or the device with `defsense capture`."
        self._rows.append(gui.add_markdown(text))
