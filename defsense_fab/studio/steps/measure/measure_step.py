"""The step Measure: check the board, record, train and evaluate, and run the device live."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ....core.device.device import Device
from ....core.errors import LiveError
from ....core.storage.files import read_regular
from ....workflow.run.choices import known_models
from ....workflow.run.outputs import LIVE_FILE, read_settings
from ....workflow.train.training import MODEL
from ....workflow.view import Client, Download, LivePlace, Request, live_messages
from ...background.latest_worker import LatestWorker
from ...messages import measure as messages
from ...session.device_session import DeviceSession
from ...session.step import Handler, Step
from .choices import find_choices
from .guided_runs import GuidedRuns
from .live_runs import LiveOptions, LiveRuns
from .recording import GuidedTasks
from .results import training_result
from .status_board import StatusBoard
from .training import TrainingTasks

_SEARCH_DELAY_S = 0.3  # after the last of several edits


class MeasureStep(Step):
    """Measures and runs the finished device; what runs ends with the studio.

    Args:
        session: The device.
        on_model: Called when a model may have been written.

    Attributes:
        board: What the tasks do, and their results.
        guided: Runs guided tasks.
        live: Runs the device live.
        place: Place of the live view.
        choices: What can be chosen, or None before the first search.
    """

    def __init__(self, session: DeviceSession, on_model: Callable[[], None]) -> None:
        super().__init__(session)
        self._on_model = on_model
        self.choices: messages.MeasureChoices | None = None
        self._search = LatestWorker(self._find_choices, session.show_error, delay_s=_SEARCH_DELAY_S)
        self.board = StatusBoard(session.server)
        self.place = LivePlace(session.server)
        self.guided = GuidedRuns(session.server, self.board, self.refresh)
        self.live = LiveRuns(self.place, self.board, self.refresh)
        self._tasks = GuidedTasks(session, self.board, self.guided)
        self._training = TrainingTasks(session, self.board, self._end_job)

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        tasks, training = self._tasks, self._training
        return {
            messages.RefreshChoices: lambda _, __: self.refresh(),
            messages.StartCheck: lambda _, r: tasks.start_check(r),
            messages.StartRecording: lambda _, r: tasks.start_recording(r),
            messages.MeasureSpecimen: lambda _, r: tasks.start_specimen(r),
            messages.StopGuided: lambda _, __: self.guided.stop(),
            live_messages.PressKey: self.guided.press,
            messages.MakeTags: lambda _, __: training.make_tags(),
            messages.RecordTwin: lambda _, r: training.record_twin(r),
            messages.ProcessSessions: lambda _, __: training.process(),
            messages.TrainModel: lambda _, r: training.train(r.sessions),
            messages.TrainOnSimulation: lambda _, __: training.train_on_simulation(),
            messages.EvaluateModel: lambda _, r: training.evaluate(r.sessions),
            messages.SimulateSpecimens: lambda _, __: training.simulate_specimens(),
            messages.FitResponse: lambda _, __: training.fit(),
            messages.UseResponse: lambda _, __: training.use_response(),
            messages.StartLive: self._start_live,
            messages.StopLive: lambda _, __: self.live.stop(),
            **self.place.handlers,
        }

    def refresh(self) -> None:
        """Search for boards, recordings, models and sessions on a thread."""
        self._search.give(self.session.device)

    def wait(self, timeout_s: float) -> bool:
        """Wait until the search has ended; return False after `timeout_s`."""
        return self._search.wait(timeout_s)

    def on_device_changed(self) -> None:
        self.refresh()

    def on_build_loaded(self) -> None:
        self.refresh()

    def disconnect(self, client: Client) -> None:
        self.place.disconnect(client)

    def download(self, path: str) -> Download | None:
        pages = {
            "measure/evaluation.html": self._training.evaluation_page,
            "measure/response.html": self._training.response_page,
        }
        page: Path | None = pages.get(path)
        if page is None:
            return None
        try:
            return Download(page.name, read_regular(page))
        except OSError:  # removed meanwhile
            return None

    def close(self) -> None:
        self.live.close()
        self.guided.close()
        self._search.close()

    def _end_job(self) -> None:
        self.refresh()
        self._on_model()

    def _start_live(self, _: Client, request: messages.StartLive) -> None:
        folder, device = self.session.project.folder, self.session.device
        model = next((m for m in known_models(device) if m.path.name == request.model), None)
        if model is None:
            raise LiveError("there is no model yet", code="no-model", action="Train a model first")
        if model.problem is not None:
            raise LiveError(model.problem, code="model-unusable")
        if not request.port.strip():
            raise LiveError("no source is chosen", code="no-source", action="Choose a source")
        words = [word.strip() for word in request.outputs.split(";")]
        settings = read_settings(
            folder,
            folder / LIVE_FILE if request.uses_file else None,
            [word for word in words if word],
            sends_to_file_outputs=request.uses_file,
        )
        self.live.start(
            LiveOptions(model.path, folder, request.port.strip(), settings, request.keeps_readings)
        )

    def _find_choices(self, device: Device) -> None:
        models = known_models(device)
        choices = find_choices(device, models)
        if choices != self.choices:
            self.choices = choices
            self.session.server.publish(choices)
        trained = next((m for m in models if m.path.name == MODEL and m.metadata), None)
        if trained is None:
            self.board.show_result(training=None)
        elif self.board.results.training is None:
            self.board.show_result(training=training_result(trained.path, trained.metadata))
