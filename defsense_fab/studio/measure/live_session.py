"""The live loop beside the page: prepared, run and ended on a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from ...core.errors import DefsenseError
from ...runtime.live.live_device import live_device
from ...runtime.live.live_run import LiveRun, RunOptions, live_run
from ..workbench.latest_worker import LatestWorker

_LOOK = 0.2  # s between looks whether it is to end
_LEAVES = 10.0  # s that it has to end


class _Stopped(Exception):
    """It was stopped before it ran."""


class LiveSession:
    """One run at a time. `told` hears what is going on, in sentences; `changed` is called once it
    runs and once it has ended; both on a thread of this. `run` is there while it runs."""

    def __init__(self, told: Callable[[str], None], changed: Callable[[], None]) -> None:
        self._told, self._changed = told, changed
        self._lock, self._stop = threading.Lock(), threading.Event()
        self.worker = LatestWorker[Callable[[], None]](
            lambda work: work(), lambda error: told(f"**{error}**")
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
        """Run a model on the device in a folder; whether it began, which it does not while another
        one is there."""
        with self._lock:
            if self.busy:
                return False
            self._stop = threading.Event()
            stop = self._stop
            self.worker.give(lambda: self._go(model, folder, options, stop))
        return True

    def stop(self) -> None:
        """Returns at once."""
        self._stop.set()

    def close(self) -> None:
        """Stop, and wait for the end."""
        self.stop()
        self.worker.wait(_LEAVES)
        self.worker.close()

    def _go(self, model: Path, folder: Path, options: RunOptions, stop: threading.Event) -> None:
        run: LiveRun | None = None
        try:
            run = self._begin(model, folder, options, stop)
            while not stop.is_set() and run.loop.wait(_LOOK):
                pass
            outcome = "The live loop has ended."
        except _Stopped:
            outcome = "The live loop was stopped before it ran."
        except DefsenseError as error:
            outcome = f"**{error}**"
        except Exception as error:  # told on the page: the studio goes on
            outcome = f"**The live loop failed ({type(error).__name__}: {error}).**"
        self.run = None  # from now on nothing is to be asked of it
        try:
            if run is not None:
                run.close()
        except DefsenseError as error:
            outcome = f"{outcome}\n\n**{error}**"
        if run is not None and run.recording is not None and run.recording.path.exists():
            outcome += f" The readings are in `{run.recording.path}`."
        self._told(outcome)
        self._changed()

    def _begin(
        self, model: Path, folder: Path, options: RunOptions, stop: threading.Event
    ) -> LiveRun:
        def progress(stage: str, share: float, message: str) -> None:
            if stop.is_set():
                raise _Stopped
            self._told(f"Preparing ({stage}, {share:.0%}): {message}")

        progress("live", 0.0, "reading the model and the build")
        run = live_run(live_device(model, folder), options, progress)
        try:
            if stop.is_set():
                raise _Stopped
            run.loop.start()
        except BaseException:
            run.close()
            raise
        self.run = run
        notes = "".join(f"\n- {note}" for note in run.notes)
        self._told(f"Live from `{options.port}`.{notes}")
        self._changed()
        return run
