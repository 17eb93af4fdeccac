"""Prepare, run and end the live loop on a thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from ...core.errors import DefsenseError
from ...runtime.live.live_device import live_device
from ...runtime.live.live_run import LiveRun, RunOptions, live_run
from ..workbench.latest_worker import LatestWorker

_STOP_CHECK_INTERVAL_S = 0.2
_CLOSE_TIMEOUT_S = 10.0  # time in which a run has to end


class _StoppedError(Exception):
    """The run was stopped before it started."""


class LiveSession:
    """Run the device live, one run at a time.

    The callbacks are called on a thread of this object.

    Args:
        on_status: Called with a text in markdown, and the error that it is about, or None.
        on_change: Called when a run has started and when it has ended.

    Attributes:
        run: The run, or None while none runs.
    """

    def __init__(
        self,
        on_status: Callable[[str, Exception | None], None],
        on_change: Callable[[], None],
    ) -> None:
        self._on_status, self._on_change = on_status, on_change
        self._lock, self._stop = threading.Lock(), threading.Event()
        self.worker = LatestWorker[Callable[[], None]](
            lambda work: work(), lambda error: on_status(f"**{error}**", error)
        )
        self.run: LiveRun | None = None

    @property
    def busy(self) -> bool:
        """Whether a run is prepared, runs or ends."""
        return self.worker.busy

    def wait(self, timeout_s: float) -> bool:
        """Wait until no run runs; return False after `timeout_s`."""
        return self.worker.wait(timeout_s)

    def start(self, model: Path, folder: Path, options: RunOptions) -> bool:
        """Run a model unless another run is running.

        Args:
            model: File of the model.
            folder: Folder of the device.
            options: Options of the run.

        Returns:
            Whether the run starts.
        """
        with self._lock:
            if self.busy:
                return False
            self._stop = threading.Event()
            stop = self._stop
            self.worker.give(lambda: self._run(model, folder, options, stop))
        return True

    def stop(self) -> None:
        """Stop the run and return at once."""
        self._stop.set()

    def close(self) -> None:
        """Stop the run and wait for its end."""
        self.stop()
        self.worker.wait(_CLOSE_TIMEOUT_S)
        self.worker.close()

    def _run(self, model: Path, folder: Path, options: RunOptions, stop: threading.Event) -> None:
        run: LiveRun | None = None
        problem: Exception | None = None
        try:
            run = self._start(model, folder, options, stop)
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
        self._on_status(outcome, problem)
        self._on_change()

    def _start(
        self, model: Path, folder: Path, options: RunOptions, stop: threading.Event
    ) -> LiveRun:
        def progress(stage: str, share: float, message: str) -> None:
            if stop.is_set():
                raise _StoppedError
            self._on_status(f"Preparing ({stage}, {share:.0%}): {message}", None)

        progress("live", 0.0, "reading the model and the build")
        run = live_run(live_device(model, folder), options, progress)
        try:
            if stop.is_set():
                raise _StoppedError
            run.loop.start()
        except BaseException:
            run.close()
            raise
        self.run = run
        notes = "".join(f"\n- {note}" for note in run.notes)
        self._on_status(f"Live from `{options.port}`.{notes}", None)
        self._on_change()
        return run
