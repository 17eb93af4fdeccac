"""The raw readings of a live run, kept as recordings are, so that a better model can decode them
again."""

from __future__ import annotations

import time
from datetime import datetime
from pathlib import Path

from ...capture.readout.recording import Recorder
from ...capture.readout.source import Event, StampedSample
from ...core.errors import DefsenseError
from ...core.files import storage_errors

BOARD = "board.csv"


class RawRecording:
    """Of `channels` channels into `folder`/board.csv, from the first sample on. What goes wrong,
    such as a full disk, is told as `trouble` and ends the recording, never the run."""

    def __init__(self, folder: Path, channels: int) -> None:
        """Raises StorageError where nothing can be written."""
        self.path = folder / BOARD
        with storage_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        self.trouble: str | None = None
        self._recorder: Recorder | None = Recorder(self.path, channels)

    def add(self, item: StampedSample | Event) -> None:
        if self._recorder is None:
            return
        try:
            self._recorder.add(item)
        except DefsenseError as error:
            self.trouble = f"the readings are no longer recorded: {error}"
            self._end()

    def close(self) -> None:
        self._end()

    def _end(self) -> None:
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        try:
            recorder.close()
        except DefsenseError as error:
            self.trouble = self.trouble or f"the end of the readings was not recorded: {error}"


def run_folder(device: Path) -> Path:
    """For a run that begins now: live/2026-11-25-14-03-09 in the device's folder."""
    return device / "live" / datetime.now().astimezone().strftime("%Y-%m-%d-%H-%M-%S")


def since_last_run(device: Path) -> float:
    """s since the last run that was kept in the device's folder ended, infinite without one."""
    ends = [path.stat().st_mtime for path in device.glob(f"live/*/{BOARD}")]
    return time.time() - max(ends) if ends else float("inf")
