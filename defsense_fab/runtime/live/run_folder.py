"""Where a live run's files go."""

from __future__ import annotations

import os
import threading
from datetime import datetime
from pathlib import Path

from ...core.errors import StorageError
from ...core.storage.files import unused_path, storage_errors


class RunFolder:
    """A folder that is made when the first file goes there: a run that does not begin leaves none.
    One that is to be `new` gets a number where another run has its name."""

    def __init__(self, path: Path, *, new: bool = False) -> None:
        self.path, self._new = path, new
        self._lock = threading.Lock()

    def make(self) -> Path:
        """Make it unless it is there, and say where it is. Raises StorageError."""
        with self._lock, storage_errors(self.path):
            while self._new:
                free = unused_path(self.path)
                try:
                    free.mkdir(parents=True)
                except FileExistsError:  # of a run that began at the same moment
                    continue
                self.path, self._new = free, False
            self.path.mkdir(parents=True, exist_ok=True)
            return self.path

    def check(self) -> None:
        """Raises StorageError where it is plain beforehand that it cannot be made."""
        there = self.path
        with storage_errors(self.path):
            while not there.exists() and there != there.parent:
                there = there.parent
        if not there.is_dir():
            raise StorageError(f"{there}: is no folder; choose another place")
        if not os.access(there, os.W_OK):
            raise StorageError(f"{there}: files cannot be made there; choose another place")


def new_run_folder(device: Path) -> RunFolder:
    """Of a run that begins now: live/2026-11-25-14-03-09 in the device's folder."""
    now = datetime.now().astimezone().strftime("%Y-%m-%d-%H-%M-%S")
    return RunFolder(device / "live" / now, new=True)
