"""Sessions, and models that are trained on them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ...capture.sessions.known_sessions import KnownSession, known_sessions
from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...store.layout import LAYOUT
from ...training.models.model_file import MODEL
from ...workflow.sessions.twin_sessions import session_folder
from ..workbench.background_job import BackgroundJob, run_with_progress
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench
from . import jobs
from .result_texts import evaluated_words, notes_list, short, trained_words

_NO_SESSION = "Choose a session that is processed, or record one first."
_BUSY = "Something is under way here; wait for it, or cancel it."


class TrainingPart:
    """A folder of the panel; what takes long is done in a process of its own, one at a time.
    `trained` is called once there is another model or session."""

    def __init__(self, bench: Workbench, trained: Callable[[], None]) -> None:
        self._bench, self._trained = bench, trained
        self.work = BackgroundJob("work", self._progress, self._ended)
        self._looking = LatestWorker(self._look, bench.show_error)
        self._sessions: list[KnownSession] = []
        self._boxes: dict[Path, Any] = {}
        self._rows: list[Any] = []  # of the sessions' folder
        self._told_of: Callable[[Any], str] = str
        self._page: Path | None = None  # of the evaluation

    def add_panel(self) -> None:
        gui, bench = self._bench.server.gui, self._bench
        with gui.add_folder("Training", expand_by_default=False):
            self._folder = gui.add_folder("Sessions")
            with gui.add_folder("Record the simulated twin", expand_by_default=False):
                self._minutes = gui.add_number(
                    "Minutes", 10.0, min=0.2, max=240.0, step=0.1, hint="Of movement"
                )
                self._unit = gui.add_number(
                    "Unit", 1, min=0, max=1_000_000_000, step=1,
                    hint="Which built device: its tolerances and pieces of cord",
                )  # fmt: skip
                self._seed = gui.add_number(
                    "Seed", 1, min=0, max=1_000_000_000, step=1, hint="Of the hand's way"
                )
                bench.button("Record the twin", "As defsense twin does", self.record_twin)
            self._process = bench.button(
                "Process the recordings", "Those that are not yet", self.process, visible=False
            )
            bench.button("Train", "On the chosen sessions; writes model.json", self.train)
            bench.button("Evaluate", "model.json, on pictures it was not trained on", self.evaluate)
            bench.button(
                "Model of the simulation", "Without any session; writes model.json", self.simulate
            )
            self._cancel = bench.button("Cancel", "Files stay as they were", self.work.cancel,
                                        visible=False)  # fmt: skip
            self._bar = gui.add_progress_bar(0.0, visible=False)
            self._told = gui.add_markdown("")
            self._result = gui.add_markdown("")
            self._open = gui.add_button(
                "Get the evaluation's page", hint="As a file of the browser", visible=False
            )
            self._open.on_click(lambda event: self._send(event.client))

    def refresh(self) -> None:
        """Look for sessions; on a thread."""
        self._looking.give(self._bench.project.device)

    def looked(self, seconds: float) -> bool:
        """Whether that is done within so many s."""
        return self._looking.wait(seconds)

    @property
    def chosen(self) -> list[Path]:
        """The sessions whose boxes are ticked."""
        return [folder for folder, box in self._boxes.items() if box.value]

    def record_twin(self) -> None:
        """A session of the device's twin."""
        device = self._bench.project.device
        if not (build_folder(device) / LAYOUT).exists():
            self._fail("A twin needs a built device: build it under *Make*.")
            return
        unit, seed = int(self._unit.value), int(self._seed.value)
        out = session_folder(device, unit, seed)
        if out.exists():
            self._fail(f"`{out.name}` is there already; choose another seed or unit.")
            return
        job = partial(jobs.record_twin, device.source, float(self._minutes.value), unit, seed)
        self._do(job, self._recorded)

    def process(self) -> None:
        """The sessions that were recorded, and are not processed yet."""
        raw = [s.folder for s in self._sessions if s.is_raw]
        if raw:
            self._do(partial(jobs.process, raw), notes_list)

    def train(self) -> None:
        """On the chosen sessions, with the simulation as far as the folds find it worth."""
        if not self.chosen:
            self._fail(_NO_SESSION)
            return
        self._do(partial(jobs.train, self._bench.project.folder, self.chosen), trained_words)

    def simulate(self) -> None:
        """A model before the first session."""
        self._do(partial(jobs.simulate, self._bench.project.folder), trained_words)

    def evaluate(self) -> None:
        """The model of the folder, on the chosen sessions."""
        folder = self._bench.project.folder
        if not (folder / MODEL).exists():
            self._fail(f"There is no `{MODEL}` yet: train one first.")
            return
        if not self.chosen:
            self._fail(_NO_SESSION)
            return
        self._do(partial(jobs.evaluate, folder, folder / MODEL, self.chosen), self._evaluated)

    def close(self) -> None:
        self.work.close()
        self._looking.close()

    def _do(self, job: Any, told_of: Callable[[Any], str]) -> None:
        if self.work.running:
            self._fail(_BUSY)
            return
        self._told_of = told_of
        self._told.content, self._bar.value = "Starting ...", 0.0
        self._result.content, self._open.visible = "", False
        self._bar.visible = self._cancel.visible = True
        self.work.start(run_with_progress, job)

    def _fail(self, told: str) -> None:
        self._told.content = f"**{told}**"

    def _progress(self, share: float, told: str) -> None:
        self._bar.value = 100 * share
        self._told.content = told

    def _ended(self, error: DefsenseError | None, result: Any) -> None:
        self._bar.visible = self._cancel.visible = False
        if error is not None:
            self._fail(str(error))
            return
        self._told.content = ""
        self._result.content = self._told_of(result)
        self.refresh()
        self._trained()

    def _recorded(self, folders: list[str]) -> str:
        names = ", ".join(f"`{short(f, self._bench.project.folder)}`" for f in folders)
        self._offer_seed(self._bench.project.device)
        return f"Recorded {names}: *Train* on it."

    def _offer_seed(self, device: Device) -> None:
        """The next whose session is not there yet."""
        free = int(self._seed.value)
        while session_folder(device, int(self._unit.value), free).exists():
            free += 1
        if free != self._seed.value:
            self._seed.value = free

    def _evaluated(self, result: dict[str, Any]) -> str:
        self._page = Path(result["page"])
        self._open.visible = True
        return evaluated_words(result)

    def _send(self, client: Any) -> None:
        if client is None or self._page is None:
            return
        try:
            content = self._page.read_bytes()
        except OSError as error:
            self._fail(f"{self._page}: cannot be read ({error.strerror}); evaluate once more.")
            return
        client.send_file_download(self._page.name, content)

    def _look(self, device: Device) -> None:
        sessions = known_sessions(device)
        with self._bench.drawing_lock:
            if sessions == self._sessions and self._rows:
                return
            self._offer_seed(device)
            self._process.visible = any(s.is_raw for s in sessions)
            was = {folder: box.value for folder, box in self._boxes.items()}
            for row in self._rows:
                row.remove()
            self._sessions, self._boxes, self._rows = sessions, {}, []
            with self._folder:
                self._add_rows(sessions, was, device)

    def _add_rows(
        self, sessions: list[KnownSession], was: dict[Path, bool], device: Device
    ) -> None:
        gui = self._bench.server.gui
        useful = [s for s in sessions if s.problem is None]
        for session in useful:
            # A new one is what the person wants to train on.
            newest = session is useful[-1]
            box = gui.add_checkbox(
                short(session.folder, device.source), was.get(session.folder, newest),
                hint=session.summary,
            )  # fmt: skip
            self._boxes[session.folder] = box
            self._rows.append(box)
        useless = [s for s in sessions if s.problem is not None]
        told = notes_list([f"`{short(s.folder, device.source)}` {s.problem}" for s in useless])
        if not sessions:
            told = "There is none yet: record the twin, or the device with `defsense capture`."
        self._rows.append(gui.add_markdown(told))
