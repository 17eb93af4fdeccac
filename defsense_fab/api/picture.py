"""Pictures that notebooks show and that can be saved."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path

from ..core.storage.files import storage_errors


@dataclass(frozen=True)
class Picture:
    """A picture as the bytes of a `png` file: the last value of a notebook's cell is shown."""

    png: bytes

    @staticmethod
    def of_uri(uri: str) -> Picture:
        """Of a data URI with a PNG in it."""
        return Picture(base64.b64decode(uri.partition(",")[2]))

    def save(self, path: str | Path) -> Path:
        """Write the PNG file. Raises StorageError."""
        path = Path(path)
        with storage_errors(path):
            path.write_bytes(self.png)
        return path

    def _repr_png_(self) -> bytes:
        return self.png
