"""Prepare, run and end the live loop on a thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import DefsenseError
from ...workflow.run.live_device import live_device
from ...workflow.run.run import LiveRun, LiveSettings, prepare_run
from ...workflow.view import PagePlace
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_texts import StatusText

_STOP_CHECK_INTERVAL_S = 0.2
_CLOSE_TIMEOUT_S = 10.0  # time in which a run has to end


class _StoppedError(Exception):
    """The run was stopped before it started."""


@dataclass(frozen=True)
class LiveRequest:
    """A run that the user requests.

    Attributes:
        model: File of the model.
        folder: Folder of the device.
        port: Source of the samples.
        settings: The outputs and controls.
        place: Place of the view on the page.
        keeps_readings: Whether the readings are saved.
    """

    model: Path
    folder: Path
    port: str
    settings: LiveSettings
    place: PagePlace
    keeps_readings: bool


class LiveSession:
    """Run the device live, one run at a time.

    Args:
        status: Shows what the run does.
        on_change: Called, on a thread of this object, when a run has started or ended.

    Attributes:
        run: The run, or None while none runs.
    """

    def __init__(self, status: StatusText, on_change: Callable[[], None]) -> None:
        self._status, self._on_change = status, on_change
        self._lock, self._stop = threading.Lock(), threading.Event()
        self.worker = LatestWorker[Callable[[], None]](lambda work: work(), status.show_error)
        self.run: LiveRun | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a run is prepared, runs or ends."""
        return self.worker.is_busy

    def wait(self, timeout_s: float) -> bool:
        """Wait until no run runs; return False after `timeout_s`."""
        return self.worker.wait(timeout_s)

    def start(self, request: LiveRequest) -> bool:
        """Run a model unless another run is running; return whether the run starts."""
        with self._lock:
            if self.is_busy:
                return False
            self._stop = threading.Event()
            stop = self._stop
            self.worker.give(lambda: self._run(request, stop))
        return True

    def stop(self) -> None:
        """Stop the run and return at once."""
        self._stop.set()

    def close(self) -> None:
        """Stop the run and wait for its end."""
        self.stop()
        self.worker.wait(_CLOSE_TIMEOUT_S)
        self.worker.close()

    def _run(self, request: LiveRequest, stop: threading.Event) -> None:
        run: LiveRun | None = None
        problem: Exception | None = None
        try:
            run = self._start(request, stop)
            while not stop.is_set() and run.loop.wait(_STOP_CHECK_INTERVAL_S):
                pass
            outcome = "The live loop has ended."
        except _StoppedError:
            outcome = "The live loop was stopped before it started."
        except DefsenseError as error:
            outcome, problem = f"**{error}**", error
        except Exception as error:  # shown on the page: the studio continues
            outcome = f"**The live loop failed ({type(error).__name__}: {error}).**"
            problem = error
        self.run = None  # nothing may use the run while it closes
        try:
            if run is not None:
                run.close()
        except DefsenseError as error:
            outcome, problem = f"{outcome}\n\n**{error}**", problem or error
        if run is not None and run.recording is not None and run.recording.path.exists():
            outcome += f" The readings are in `{run.recording.path}`."
        code = problem.code if isinstance(problem, DefsenseError) else ""
        self._status.show(outcome, code, problem)
        self._on_change()

    def _start(self, request: LiveRequest, stop: threading.Event) -> LiveRun:
        def progress(stage: str, share: float, message: str) -> None:
            if stop.is_set():
                raise _StoppedError
            self._status.show(f"Preparing ({stage}, {share:.0%}): {message}")

        progress("live", 0.0, "reading the model and the build")
        run = prepare_run(
            live_device(request.model, request.folder),
            request.port,
            settings=request.settings,
            view=request.place,
            keeps_readings=request.keeps_readings,
            progress=progress,
        )
        try:
            if stop.is_set():
                raise _StoppedError
            run.loop.start()
        except BaseException:
            run.close()
            raise
        self.run = run
        notes = "".join(f"\n- {note}" for note in run.notes)
        self._status.show(f"Live from `{request.port}`.{notes}")
        self._on_change()
        return run
