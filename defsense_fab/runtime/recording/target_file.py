"""Write the decoded targets of a live run to a table."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TextIO

import numpy as np

from ...core.errors import StorageError
from ...core.storage.files import storage_errors
from ..frames.live_frame import LiveFrame, Note

#: Name of the file in the folder of a run.
TARGETS = "targets.csv"
_FLUSH_INTERVAL_S = 1.0  # so that a program that is killed loses little


class TargetFile:
    """A `FrameSink` that writes a row for each decoded frame.

    The columns are the time (s), each number of the targets with its unit in the header, the half
    width of each target's interval, and the quality. The file is created with the first frame.

    Args:
        folder: Returns the folder of the run, and creates it.

    Attributes:
        trouble: Why nothing is written any more, or None.
    """

    name = "targets"
    news: Note | None = None

    def __init__(self, folder: Callable[[], Path]) -> None:
        self._folder = folder
        self._file: TextIO | None = None
        self._flushed_at = -np.inf
        self.trouble: Note | None = None
        self.path: Path | None = None

    def send(self, frame: LiveFrame) -> None:
        """Write a frame; a failure is reported as `trouble` and never ends the run."""
        if frame.targets is None or self.trouble is not None:
            return
        try:
            with storage_errors(self.path or Path(TARGETS)):
                self._write(frame)
        except StorageError as error:
            self.trouble = Note.from_error(error, "the targets are no longer recorded: ")

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def _write(self, frame: LiveFrame) -> None:
        assert frame.targets is not None
        if self._file is None:
            self.path = self._folder() / TARGETS
            self._file = self.path.open("w", encoding="utf-8", newline="")
            units = zip(frame.targets.names, frame.targets.units, strict=True)
            widths = [f"{name}_half_width{f'_{unit}' if unit else ''}" for name, unit in units]
            names = ["time", *frame.targets.columns(), *widths, "quality"]
            self._file.write(",".join(map(_quoted, names)) + "\n")
        numbers = [*frame.markers.ravel().tolist(), *frame.radius.tolist()]
        cells = [f"{x:.6g}" if np.isfinite(x) else "" for x in numbers]
        self._file.write(",".join([f"{frame.time:.6f}", *cells, frame.quality.value]) + "\n")
        if frame.time - self._flushed_at > _FLUSH_INTERVAL_S:
            self._flushed_at = frame.time
            self._file.flush()


def _quoted(name: str) -> str:
    return f'"{name}"' if any(c in name for c in ',;\t"') else name
