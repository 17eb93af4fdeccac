"""Rows of numbers that are added to a file without a name, and read when all are there."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from ...core.errors import StorageError
from ...core.storage.files import storage_errors
from .animation import Float32


class RowFile:
    """Rows of `width` float32 in a temporary file in `folder`, which no one else sees and which is
    gone when it is closed or the program ends."""

    def __init__(self, folder: Path, width: int) -> None:
        """Raises StorageError where there can be no such file."""
        self.width, self.count = width, 0
        if not folder.is_dir():
            raise StorageError(
                "the folder does not exist",
                code="folder-not-found",
                where=folder,
                action="Create it or choose another folder",
            )
        with storage_errors(folder):
            # Without a buffer: what does not fit on the disk is told with the row that does not.
            self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115

    @property
    def size(self) -> int:
        """Bytes of all rows."""
        return 4 * self.width * self.count

    def add(self, row: Float32) -> None:
        """Raises OSError where the disk takes only a part of it; the rows before it stay."""
        data = memoryview(np.asarray(row, np.float32).tobytes())
        try:
            while data:
                data = data[self._file.write(data) :]
        except OSError:
            self._file.seek(self.size)
            self._file.truncate()
            raise
        self.count += 1

    def rows(self) -> Float32:
        """(count, width), read from the disk as it is used."""
        if not self.count:
            return np.empty((0, self.width), np.float32)
        return np.memmap(self._file, np.float32, "r", shape=(self.count, self.width))

    def close(self) -> None:
        self._file.close()
