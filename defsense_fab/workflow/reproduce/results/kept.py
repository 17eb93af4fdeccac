"""Results that are kept: taken as they are while all that they were made from is unchanged."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ....core.storage.files import write_json

#: Raised when the same inputs give other results, so that those of older versions are not taken.
_VERSION = 1


def kept(path: Path, key: str) -> Any | None:
    """What the file has for this key; None where there is nothing, or it was made from
    something else."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(found, dict) or found.get("key") != _stamped(key):
        return None
    return found.get("result")


def keep(path: Path, key: str, result: Any) -> None:
    """Plain values, for `kept`. Raises StorageError."""
    write_json(path, {"key": _stamped(key), "result": result})


def once(path: Path, key: str, make: Callable[[], Any]) -> Any:
    """What is kept, or what `make` gives, which is then kept; None is not kept."""
    found = kept(path, key)
    if found is not None:
        return found
    keep(path, key, make())
    return kept(path, key)  # lists in place of tuples, now as later


def _stamped(key: str) -> str:
    return f"{_VERSION}-{key}"
