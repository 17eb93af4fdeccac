"""Names of files and folders that every system can have: Windows is the strictest."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

from ..errors import StorageError

#: What no name of a file may contain, besides control characters.
FORBIDDEN = '<>:"/\\|?*'
#: Names that belong to devices of Windows, with whatever suffix.
_RESERVED = re.compile(
    r"con|prn|aux|nul|(com|lpt)[0-9\u00b9\u00b2\u00b3]|con(in|out)\$", re.IGNORECASE
)
_ODD = re.compile(f"[{re.escape(FORBIDDEN)}\x00-\x1f]")
_LONGEST, _SAFE = 120, 60  # bytes, of a name alone: paths have limits, too


def is_reserved(name: str) -> bool:
    """Whether Windows takes it for a device: by what stands before the first full stop."""
    return _RESERVED.fullmatch(name.partition(".")[0].rstrip()) is not None


def folded(name: str) -> str:
    """Equal for names that some file system takes for one."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def refusal(name: str) -> str | None:
    """Why no file can be called so, with what to do; None where it can, on every system."""
    if is_reserved(name):
        return f"Windows keeps the name {name!r} for itself; choose another"
    bad = _ODD.search(name)
    if bad or name.endswith((".", " ")):
        why = f"contains {bad[0]!r}" if bad else "ends with a point or a space"
        return f"the name {why}, which Windows cannot have; use letters, digits and hyphens"
    try:
        if len(name.encode()) > _LONGEST:
            return f"the name is too long; use fewer letters ({_LONGEST} bytes)"
    except UnicodeEncodeError:
        return "the name is no text in this system's encoding; use letters, digits and hyphens"
    return None


def check_folder_name(folder: Path) -> None:
    """Raises StorageError for a folder whose name not every system can have, or that of one above
    it which is yet to be made."""
    path = folder.resolve()
    for one in (path, *(p for p in path.parents if not p.exists())):
        why = refusal(one.name)
        if why:
            raise StorageError(f"{folder}: {why}", code="bad-file-name", name=one.name)


def safe_name(name: str) -> str:
    """A name for a file, made of one that came from elsewhere: letters of any script and digits, no
    folders, no suffix, no hidden files, none that a system keeps for itself."""
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    stem = re.sub(r"[^\w-]+", "-", last.rpartition(".")[0] or last).strip("-_")
    stem = stem.encode()[:_SAFE].decode(errors="ignore") or "body"
    return f"body-{stem}" if is_reserved(stem) else stem
