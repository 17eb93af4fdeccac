"""Pictures that notebooks show and that can be saved."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import StorageError
from ..core.storage.files import replace_file
from . import given


@dataclass(frozen=True)
class Picture:
    """A picture as the bytes of a `png` file: the last value of a notebook's cell is shown."""

    png: bytes

    @staticmethod
    def of_uri(uri: str) -> Picture:
        """Of a data URI with a PNG in it."""
        return Picture(base64.b64decode(uri.partition(",")[2]))

    def save(self, path: str | Path) -> Path:
        """Write the .png file, whole or not at all. Raises StorageError, for other suffixes too."""
        file = given.path(path, "path", StorageError)
        if file.suffix.lower() != ".png":
            raise StorageError(f"{file}: a picture is a .png file; let its name end so")
        with replace_file(file) as temporary:
            temporary.write_bytes(self.png)
        return file

    def _repr_png_(self) -> bytes:
        return self.png
