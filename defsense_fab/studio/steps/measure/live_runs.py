"""Prepare, run and end the live loop on a thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ....core.errors import DefsenseError
from ....workflow.run.live_device import live_device
from ....workflow.run.run import LiveRun, LiveSettings, prepare_run
from ....workflow.view import LivePlace
from ...background.latest_worker import LatestWorker
from .status_board import StatusBoard

_STOP_CHECK_INTERVAL_S = 0.2
_CLOSE_TIMEOUT_S = 10.0  # time in which a run has to end


class _StoppedError(Exception):
    """The run was stopped before it started."""


@dataclass(frozen=True)
class LiveOptions:
    """A run that the user requests.

    Attributes:
        model: File of the model.
        folder: Folder of the device.
        port: Source of the samples.
        settings: The outputs and controls.
        keeps_readings: Whether the readings are saved.
    """

    model: Path
    folder: Path
    port: str
    settings: LiveSettings
    keeps_readings: bool


class LiveRuns:
    """Run the device live, one run at a time.

    Args:
        place: Place of the view on the page.
        board: Shows what the run does.
        on_end: Called, on a thread of this object, when a run has ended.

    Attributes:
        run: The run, or None while none runs.
    """

    def __init__(self, place: LivePlace, board: StatusBoard, on_end: Callable[[], None]) -> None:
        self._place, self._board, self._on_end = place, board, on_end
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._worker = LatestWorker[Callable[[], None]](lambda work: work(), lambda _: None)
        self.run: LiveRun | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a run is prepared, runs or ends."""
        return self._worker.is_busy

    def wait(self, timeout_s: float) -> bool:
        """Wait until no run runs; return False after `timeout_s`."""
        return self._worker.wait(timeout_s)

    def start(self, options: LiveOptions) -> None:
        """Run a model.

        Raises:
            DefsenseError: Another run is running or ending (`busy`).
        """
        with self._lock:
            if self.is_busy:
                raise DefsenseError(
                    "the live view is running or ending", code="busy", action="Stop it first"
                )
            self._stop = threading.Event()
            stop = self._stop
            self._board.show("live", "Preparing ...", state="running")
            self._worker.give(lambda: self._run(options, stop))

    def stop(self) -> None:
        """Stop the run and return at once."""
        if self.is_busy:
            self._board.show("live", "Stopping ...", state="stopping")
        self._stop.set()

    def close(self) -> None:
        """Stop the run and wait for its end."""
        self._stop.set()
        self._worker.wait(_CLOSE_TIMEOUT_S)
        self._worker.close()

    def _run(self, options: LiveOptions, stop: threading.Event) -> None:
        run: LiveRun | None = None
        problem: Exception | None = None
        text = ""
        try:
            run = self._start(options, stop)
            while not stop.is_set() and run.loop.wait(_STOP_CHECK_INTERVAL_S):
                pass
            text = "The live view has ended."
        except _StoppedError:
            text = "Stopped before it started."
        except Exception as error:  # shown on the page: the studio continues
            problem = error
        self.run = None  # nothing may use the run while it closes
        try:
            if run is not None:
                run.close()
        except DefsenseError as error:
            problem = problem or error
        if run is not None and run.recording is not None and run.recording.path.exists():
            text += f" The readings are in {_relative(run.recording.path, options.folder)}."
        self._board.show("live", text.strip(), error=problem)
        self._on_end()

    def _start(self, options: LiveOptions, stop: threading.Event) -> LiveRun:
        def progress(_: str, share: float, message: str) -> None:
            if stop.is_set():
                raise _StoppedError
            if share < 1:
                self._board.show("live", f"Preparing: {message} ({share:.0%})", state="running")

        progress("live", 0.0, "reading the model and the build")
        run = prepare_run(
            live_device(options.model, options.folder),
            options.port,
            settings=options.settings,
            view=self._place,
            keeps_readings=options.keeps_readings,
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
        text = " ".join([f"Live from {options.port}.", *(f"{note}." for note in run.notes)])
        self._board.show("live", text, "live", state="running")
        return run


def _relative(path: Path, folder: Path) -> Path:
    return path.relative_to(folder) if path.is_relative_to(folder) else path
