"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..core.files import storage_errors


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name beside `path`, of the same suffix, to write to: moved into place at the end, gone
    after an error. Raises StorageError where the system refuses."""
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        with storage_errors(path):
            yield temporary
            os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
