"""Names of files and folders that are valid on every operating system; Windows is the strictest."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

from ..errors import StorageError

#: Characters that no file name may contain, in addition to control characters.
FORBIDDEN_CHARACTERS = '<>:"/\\|?*'
#: Names of Windows devices, with any suffix.
_RESERVED = re.compile(
    r"con|prn|aux|nul|(com|lpt)[0-9\u00b9\u00b2\u00b3]|con(in|out)\$", re.IGNORECASE
)
_FORBIDDEN = re.compile(f"[{re.escape(FORBIDDEN_CHARACTERS)}\x00-\x1f]")
_MAX_NAME_BYTES = 120  # of a name alone, since whole paths have limits, too
_MAX_SAFE_NAME_BYTES = 60


def is_reserved(name: str) -> bool:
    """Return whether Windows takes a name, up to its first full stop, for a device."""
    return _RESERVED.fullmatch(name.partition(".")[0].rstrip()) is not None


def fold_name(name: str) -> str:
    """Return a text that is equal for names that some file system cannot tell apart."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def name_problem(name: str) -> str | None:
    """Return why no file can have a name, and what to do; None for a name that is valid."""
    if is_reserved(name):
        return f"the name {name!r} is reserved by Windows; choose another"
    match = _FORBIDDEN.search(name)
    if match or name.endswith((".", " ")):
        reason = f"contains {match[0]!r}" if match else "ends with a full stop or a space"
        return f"the name {reason}, which Windows does not allow; use letters, digits and hyphens"
    try:
        if len(name.encode()) > _MAX_NAME_BYTES:
            return f"the name has more than {_MAX_NAME_BYTES} bytes; use fewer letters"
    except UnicodeEncodeError:
        return "the name cannot be encoded as UTF-8; use letters, digits and hyphens"
    return None


def check_folder_name(folder: Path) -> None:
    """Check the name of a folder, and those of its parents that do not exist yet.

    Args:
        folder: Folder to be created.

    Raises:
        StorageError: Some operating system cannot have such a folder.
    """
    path = folder.resolve()
    for new in (path, *(p for p in path.parents if not p.exists())):
        problem = name_problem(new.name)
        if problem:
            raise StorageError(problem, code="file-name-invalid", where=folder, name=new.name)


def safe_name(name: str) -> str:
    """Derive a file name from a name of unknown origin.

    Args:
        name: A name or path, such as that of an uploaded file.

    Returns:
        Letters of any script and digits, without folders and suffix; neither hidden nor reserved.
    """
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    stem = re.sub(r"[^\w-]+", "-", last.rpartition(".")[0] or last).strip("-_")
    stem = stem.encode()[:_MAX_SAFE_NAME_BYTES].decode(errors="ignore") or "body"
    return f"body-{stem}" if is_reserved(stem) else stem
