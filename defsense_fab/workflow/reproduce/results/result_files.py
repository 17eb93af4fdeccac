"""Files of an experiment's results: values that are kept while their inputs are unchanged, and
pictures for papers and slides."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....core.storage.files import replace_file, storage_errors, write_json

#: Raised when the same inputs give other results, so that results of older versions are not used.
RESULTS_VERSION = 1


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
    if not isinstance(data, dict) or data.get("key") != _versioned(key):
        return None
    return data.get("result")


def keep(path: Path, key: str, result: Any) -> None:
    """Write plain values for `load_kept`.

    Raises:
        StorageError: The file cannot be written.
    """
    write_json(path, {"key": _versioned(key), "result": result})


def compute_once(path: Path, key: str, make: Callable[[], Any]) -> Any:
    """Return the kept result, or that of `make`, which is then kept; None is not kept."""
    result = load_kept(path, key)
    if result is not None:
        return result
    keep(path, key, make())
    return load_kept(path, key)  # with lists in place of tuples, as it is loaded later


def _versioned(key: str) -> str:
    return f"{RESULTS_VERSION}-{key}"


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
            temporary.write_bytes(_decode(uri))


def combine_pictures(
    rows: Sequence[tuple[str, Sequence[str]]], titles: Sequence[str], width: float
) -> str:
    """Combine pictures to one.

    Args:
        rows: The title of each row, which is written below it, and its pictures as data URIs.
        titles: Titles of the columns.
        width: Width of a column, px.

    Returns:
        PNG as a data URI.
    """
    from ....report.pictures.sheet import SMALL, Sheet

    images = [[_load_image(uri, width) for uri in row] for _, row in rows]
    heights = [max(i.shape[0] for i in row) for row in images]
    sheet = Sheet(width * len(titles), sum(heights) + 2 * SMALL * (len(rows) + 1))
    for k, title in enumerate(titles):
        sheet.text(((k + 0.5) * width, SMALL), title, SMALL, bold=True)
    y = 2.0 * SMALL
    for (title, _), row, height in zip(rows, images, heights, strict=True):
        for k, image in enumerate(row):
            sheet.paste(image, ((k + 0.5) * width - image.shape[1] / 2, y))
        y += height
        if title:
            sheet.text((width * len(titles) / 2, y + SMALL / 2), title, SMALL)
        y += 2 * SMALL
    return sheet.uri()


def _load_image(uri: str, max_width: float) -> Any:
    """Return the pixels (h, w, 3) of a picture."""
    from PIL import Image

    with Image.open(io.BytesIO(_decode(uri))) as image:
        image.thumbnail((int(max_width), 10_000))
        return np.asarray(image.convert("RGB"))


def _decode(uri: str) -> bytes:
    return base64.b64decode(uri.partition(",")[2])
