"""The raw readings of a live run, kept as recordings are, so that a better model can decode them
again."""

from __future__ import annotations

import threading
import time
from pathlib import Path

from ...capture.readout.recording import Recorder
from ...capture.readout.source import Event, StampedSample
from ...core.errors import DefsenseError
from .run_folder import RunFolder

BOARD = "board.csv"


class RawRecording:
    """Of `channels` channels into `folder`/board.csv, which is made with the first sample. What
    goes wrong, such as a full disk, is told as `trouble` and ends the recording, never the run."""

    def __init__(self, folder: RunFolder, channels: int) -> None:
        """Raises StorageError where nothing can be written, CaptureError where there is a file
        that the recording cannot go on with."""
        folder.check()
        self.trouble: str | None = None
        self._folder, self._channels = folder, channels
        self._begun, self._over = threading.Event(), False
        self._early = list[Event]()  # what happened before the first sample
        self._recorder: Recorder | None = None
        if self.path.exists():
            self._recorder = Recorder(self.path, channels)
            self._begun.set()

    @property
    def path(self) -> Path:
        return self._folder.path / BOARD

    def wait_until_begun(self, seconds: float) -> bool:
        """Whether there is a file within so many seconds: its `path` stays from then on."""
        return self._begun.wait(seconds)

    def add(self, item: StampedSample | Event) -> None:
        if self._over:
            return
        if self._recorder is None and isinstance(item, Event):
            self._early.append(item)
            return
        try:
            if self._recorder is None:
                self._folder.make()
                self._recorder = Recorder(self.path, self._channels)
                self._recorder.extend(self._early)
                self._begun.set()
            self._recorder.add(item)
        except DefsenseError as error:
            what = "are no longer" if self._begun.is_set() else "cannot be"
            self.trouble = f"the readings {what} recorded: {error}"
            self._end()

    def close(self) -> None:
        self._end()

    def _end(self) -> None:
        self._over = True
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        try:
            recorder.close()
        except DefsenseError as error:
            self.trouble = self.trouble or f"the end of the readings was not recorded: {error}"


def since_last_run(device: Path) -> float:
    """s since the last run that was kept in the device's folder ended, infinite without one."""
    ends = [path.stat().st_mtime for path in device.glob(f"live/*/{BOARD}")]
    return time.time() - max(ends) if ends else float("inf")
