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
_WAITS = 5.0  # s after something went wrong, until it is tried again
_EARLY = 100  # events that are kept before the first sample


class RawRecording:
    """Of `channels` channels into `folder`/board.csv, which is made with the first sample. What
    goes wrong, such as a full disk, is told as `trouble` and never ends the run: after some seconds
    the recording goes on where it can. Samples of other channels are left out."""

    def __init__(self, folder: RunFolder, channels: int) -> None:
        """Raises StorageError where nothing can be written, CaptureError where there is a file
        that the recording cannot go on with."""
        folder.check()
        self.trouble: str | None = None
        self._folder, self._channels = folder, channels
        self._begun, self._over = threading.Event(), False
        self._again = 0.0  # when to try again, by time.monotonic
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
        if self._over or time.monotonic() < self._again:
            return
        if self._recorder is None and isinstance(item, Event):
            self._early = [*self._early, item][-_EARLY:]
            return
        if isinstance(item, StampedSample) and len(item.sample.sums) != self._channels:
            self.trouble = (
                f"a sample of {len(item.sample.sums)} channels is not recorded among those of"
                f" {self._channels}; another program changed the read-out board's settings"
            )
            return
        try:
            if self._recorder is None:
                self._folder.make()
                self._recorder = Recorder(self.path, self._channels)
                self._recorder.extend(self._early)
                self._begun.set()
            self._recorder.add(item)
            self.trouble, self._early = None, []
        except DefsenseError as error:
            what = "are no longer" if self._begun.is_set() else "cannot be"
            self.trouble = f"the readings {what} recorded: {error}"
            self._again = time.monotonic() + _WAITS
            self._leave()

    def close(self) -> None:
        self._over = True
        self._leave()

    def _leave(self) -> None:
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
