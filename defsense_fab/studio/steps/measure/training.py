"""Long tasks of the step Measure in a child process: recordings of the twin, training, fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, get_args

from ....core.errors import CalibrationError, CaptureError, DefsenseError, TrainingError
from ....workflow.calibrate.simulated_specimens import simulate_specimens
from ....workflow.run.choices import is_built
from ....workflow.sessions.known_sessions import known_sessions
from ....workflow.sessions.twin_sessions import session_folder
from ....workflow.tags.options import MARKERS_FOLDER
from ....workflow.train.options import CordFamilyName, TwinOptions
from ....workflow.train.training import MODEL
from ...background.background_job import run_with_progress
from ...edits.body import use_response
from ...messages import measure as messages
from ...session.device_session import DeviceSession
from ...session.job_strip import Work
from . import jobs
from .choices import relative_name
from .device_paths import inside
from .results import evaluation_result, response_result, training_result
from .specimens import RESPONSE_FILE, SIMULATED_PREFIX, specimen_sessions
from .status_board import StatusBoard, TaskName


class TrainingTasks:
    """Starts jobs in a child process, and shows their results.

    Args:
        session: The device.
        board: Shows what the jobs do.
        on_end: Called once a job has ended.

    Attributes:
        evaluation_page: Report of the last evaluation, or None.
        response_page: Report of the last fit, or None.
    """

    def __init__(
        self, session: DeviceSession, board: StatusBoard, on_end: Callable[[], None]
    ) -> None:
        self._session, self._board, self._on_end = session, board, on_end
        self.evaluation_page: Path | None = None
        self.response_page: Path | None = None

    @property
    def _folder(self) -> Path:
        return self._session.project.folder

    def make_tags(self) -> None:
        """Write the device's tags, after asking whether the body's script may run."""
        inside(self._folder, MARKERS_FOLDER, CaptureError)
        if self._session.may_run_script(self.make_tags):
            self._start(
                "record",
                "Make the tags",
                partial(jobs.make_tags, self._folder),
                self._show_tags,
            )

    def record_twin(self, request: messages.RecordTwin) -> None:
        """Record a session of the device's simulated twin."""
        device = self._session.device
        if not is_built(device):
            raise CaptureError(
                "the device is not built yet", code="not-built", action="Build it in Make"
            )
        out = session_folder(device, request.unit, request.seed)
        if out.exists():
            raise CaptureError(
                "exists already",
                code="file-exists",
                where=out.name,
                action="Choose another seed or unit",
            )
        families = {name: name for name in get_args(CordFamilyName)}
        if request.cords and request.cords not in families:
            raise CaptureError(f"{request.cords!r} is not a family of cords", code="unknown-cords")
        options = TwinOptions(
            minutes=request.minutes,
            unit=request.unit,
            seed=request.seed,
            cords=families.get(request.cords),
        )
        task = partial(jobs.record_twin, device.source, options)
        self._start("record", "Record the simulated twin", task, self._show_recorded)

    def process(self) -> None:
        """Process the recorded sessions that are not processed yet."""
        raw = [s.folder for s in known_sessions(self._session.device) if s.is_raw]
        if not raw:
            raise CaptureError("all sessions are processed", code="nothing-to-process")
        task = partial(jobs.process, raw)
        self._start("train", "Process the recordings", task, self._show_processed)

    def train(self, sessions: Sequence[str]) -> None:
        """Train a model on sessions; cross-validation decides the simulation's part."""
        self._train("Train a model", self._chosen(sessions))

    def train_on_simulation(self) -> None:
        """Train a model on the simulated states alone."""
        self._train("Train a model on the simulation", [])

    def evaluate(self, sessions: Sequence[str]) -> None:
        """Evaluate the folder's model on sessions."""
        if not (self._folder / MODEL).exists():
            raise TrainingError(
                "there is no model yet", code="no-model", action="Train a model first"
            )
        task = partial(jobs.evaluate, self._folder, self._folder / MODEL, self._chosen(sessions))
        self._start("train", "Evaluate the model", task, self._show_evaluated)

    def simulate_specimens(self) -> None:
        """Simulate sessions on specimens of the device's cord."""
        task = partial(
            simulate_specimens,
            self._folder,
            response=self._session.device.cord.response,
            prefix=SIMULATED_PREFIX,
        )
        self._start("specimen", "Simulate specimens", task, self._show_simulated)

    def fit(self) -> None:
        """Fit the response to the specimens of the folder, and write it next to device.toml."""
        from ....workflow.calibrate.fit_response import fit_response

        every = specimen_sessions(self._folder)
        measured = [p for p in every if not p.name.startswith(SIMULATED_PREFIX)]
        used = measured or every
        if not used:
            raise CalibrationError(
                "no specimen was measured yet",
                code="no-specimen",
                action="Measure or simulate specimens first",
            )
        task = partial(fit_response, used, self._folder / RESPONSE_FILE)
        self._board.show_result(response=None)
        self._start(
            "specimen",
            "Fit the response",
            task,
            lambda result: self._show_fit(result, is_simulated=not measured),
        )

    def use_response(self) -> None:
        """Replace the device's response by the fitted one."""
        response = self._board.results.response
        if response is None:
            raise CalibrationError(
                "no response was fitted yet", code="no-response", action="Fit one first"
            )
        self._session.apply(use_response(RESPONSE_FILE))
        self._board.show_result(response=_used(response))
        self._board.show(
            "specimen",
            "The device uses the measured response. Optimize the cords and build it again.",
            "response-used",
        )

    def _train(self, title: str, sessions: list[Path]) -> None:
        task = partial(jobs.train, self._folder, sessions)
        self._start("train", title, task, self._show_trained)

    def _chosen(self, names: Sequence[str]) -> list[Path]:
        """Return the folders of sessions by their names."""
        device = self._session.device
        known = {relative_name(s.folder, device.source): s for s in known_sessions(device)}
        if not names:
            raise TrainingError(
                "no session is chosen",
                code="no-session-chosen",
                action="Choose a processed session, or record one first",
            )
        for name in names:
            if name not in known or not known[name].is_usable:
                raise TrainingError(
                    "cannot be used for training", code="session-unusable", where=name
                )
        return [known[name].folder for name in names]

    def _start(
        self,
        name: TaskName,
        title: str,
        task: Callable[..., Any],
        on_result: Callable[[Any], None],
    ) -> None:
        def end(error: DefsenseError | None, result: Any) -> None:
            if error is None:
                on_result(result)
            else:
                self._board.show_end(name, error)
            self._on_end()

        work = Work("job", title, run_with_progress, (task,), on_end=end)
        before = self._board.task(name)
        self._board.show(name, f"{title} ...", state="running")
        try:
            self._session.jobs.start(work)
        except DefsenseError:
            self._board.show(name, before.text, before.code, state=before.state)
            raise

    def _show_tags(self, notes: list[str]) -> None:
        text = " ".join(["Print the tags: markers/markers.pdf.", *notes])
        self._board.show("record", text, "tags-made")

    def _show_recorded(self, folders: list[str]) -> None:
        names = ", ".join(relative_name(f, self._folder) for f in folders)
        self._board.show("record", f"Recorded {names}. Train a model on it next.", "twin-recorded")

    def _show_processed(self, lines: list[str]) -> None:
        text = " ".join(line.replace("`", "") for line in lines)
        self._board.show("train", text, "sessions-processed")

    def _show_trained(self, result: jobs.TrainingResult) -> None:
        self._board.show_result(
            training=training_result(result.path, result.metadata, result.notes), evaluation=None
        )
        self.evaluation_page = None
        self._board.show("train", f"Wrote {Path(result.path).name}.", "model-trained")

    def _show_evaluated(self, result: jobs.EvaluationResult) -> None:
        self.evaluation_page = Path(result.page)
        self._board.show_result(evaluation=evaluation_result(result, MODEL))
        self._board.show("train", "", "model-evaluated")

    def _show_simulated(self, sessions: list[Path]) -> None:
        names = ", ".join(session.name for session in sessions)
        text = f"Simulated {names}. Fit the response next."
        self._board.show("specimen", text, "specimens-simulated")

    def _show_fit(self, result: Any, *, is_simulated: bool) -> None:
        self.response_page = result.page
        self._board.show_result(response=response_result(result.data, is_simulated=is_simulated))
        self._board.show("specimen", "", "response-fitted")


def _used(response: messages.ResponseResult) -> messages.ResponseResult:
    from msgspec.structs import replace

    return replace(response, can_use=False)
