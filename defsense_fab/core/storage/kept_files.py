"""Sizes of caches: measure, limit and clear what is kept to save time."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterable
from pathlib import Path


def size_of(path: Path) -> int:
    """Return the size in bytes of a file, or of all files in a folder; 0 if it is gone."""
    with contextlib.suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            return sum(size_of(child) for child in path.iterdir())
        return path.lstat().st_size
    return 0


def delete(path: Path) -> bool:
    """Delete a file or folder; return whether it is gone."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
    return not os.path.lexists(path)


def delete_oldest(paths: Iterable[Path], max_bytes: int) -> None:
    """Delete the oldest files or folders, so that at most `max_bytes` are left."""
    total = 0
    ages = []
    for path in paths:
        with contextlib.suppress(OSError):
            ages.append((path.stat().st_mtime, path))
    for _, path in sorted(ages, reverse=True):
        total += size_of(path)
        if total > max_bytes:
            delete(path)
