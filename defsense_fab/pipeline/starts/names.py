"""Names of folders and files that every system can have."""

from __future__ import annotations

import re
from pathlib import Path

from ...core.errors import StorageError

_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)", re.IGNORECASE)  # names that are devices
_FORBIDDEN = re.compile(r'[<>:"|?*\x00-\x1f]')


def safe_name(name: str) -> str:
    """A name for a file, made of one that came from elsewhere: no folders, no suffix, no hidden
    files, none that a system keeps for itself."""
    last = re.split(r"[/\\]", name)[-1]
    stem = re.sub(r"[^\w-]+", "-", last.rpartition(".")[0] or last, flags=re.ASCII)
    stem = stem.strip("-_")[:60] or "body"
    return f"body-{stem}" if _RESERVED.fullmatch(stem) else stem


def check_folder_name(folder: Path) -> None:
    """Raises StorageError for a folder whose name not every system can have."""
    name = folder.resolve().name
    if _RESERVED.fullmatch(name.partition(".")[0]):
        raise StorageError(f"{folder}: Windows keeps the name {name!r} for itself; choose another")
    bad = _FORBIDDEN.search(name)
    if bad or name.endswith((".", " ")):
        why = f"contains {bad[0]!r}" if bad else "ends with a point or a space"
        raise StorageError(
            f"{folder}: the name {why}, which Windows cannot have; use letters, digits and hyphens"
        )
    if len(name.encode()) > 120:
        raise StorageError(f"{folder}: the name is too long; use at most 120 letters")
