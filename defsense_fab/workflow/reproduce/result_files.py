"""Files of an experiment's results: values that are kept while their inputs are unchanged."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ...core.storage.files import replace_file, storage_errors, write_json

#: Raised when the same inputs give other results, so that results of older versions are not used.
RESULTS_VERSION = 2


def load_kept(path: Path, key: str) -> Any | None:
    """Return the result that was kept for a key.

    Args:
        path: The file.
        key: Hash of the inputs.

    Returns:
        Plain values; None if there are none, or if they were computed from other inputs.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(data, dict) or data.get("key") != f"{RESULTS_VERSION}-{key}":
        return None
    return data.get("result")


def keep(path: Path, key: str, result: Any) -> None:
    """Write plain values for `load_kept`.

    Raises:
        StorageError: The file cannot be written.
    """
    write_json(path, {"key": f"{RESULTS_VERSION}-{key}", "result": result})


def compute_once(path: Path, key: str, make: Callable[[], Any]) -> Any:
    """Return the kept result, or that of `make`, which is then kept; None is not kept."""
    result = load_kept(path, key)
    if result is not None:
        return result
    keep(path, key, make())
    return load_kept(path, key)  # with lists in place of tuples, as it is loaded later


def write_pictures(folder: Path, pictures: Mapping[str, str]) -> None:
    """Write pictures as PNG files.

    Args:
        folder: The folder, which is created if needed.
        pictures: Data URIs by file name without suffix.

    Raises:
        StorageError: A file cannot be written.
    """
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for name, uri in pictures.items():
        with replace_file(folder / f"{name}.png") as temporary:
            temporary.write_bytes(base64.b64decode(uri.partition(",")[2]))
