"""Pictures of the page as files, for papers and slides, and many of them as one."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....core.storage.files import replace_file, storage_errors


def write_pictures(folder: Path, pictures: Mapping[str, str]) -> None:
    """PNGs as data URIs, each by its name without suffix. Raises StorageError."""
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for name, uri in pictures.items():
        with replace_file(folder / f"{name}.png") as temporary:
            temporary.write_bytes(_bytes(uri))


def in_rows(rows: Sequence[tuple[str, Sequence[str]]], titles: Sequence[str], width: float) -> str:
    """PNGs as data URIs in rows with a title below each, of as many columns as there are `titles`
    of those, `width` pixels wide; as one such."""
    from ....report.pictures.sheet import SMALL, Sheet

    images = [[_image(uri, width) for uri in row] for _, row in rows]
    high = [max(i.shape[0] for i in row) for row in images]
    sheet = Sheet(width * len(titles), sum(high) + 2 * SMALL * (len(rows) + 1))
    for k, title in enumerate(titles):
        sheet.text(((k + 0.5) * width, SMALL), title, SMALL, bold=True)
    y = 2.0 * SMALL
    for (title, _), row, height in zip(rows, images, high, strict=True):
        for k, image in enumerate(row):
            sheet.paste(image, ((k + 0.5) * width - image.shape[1] / 2, y))
        y += height
        if title:
            sheet.text((width * len(titles) / 2, y + SMALL / 2), title, SMALL)
        y += 2 * SMALL
    return sheet.uri()


def _image(uri: str, width: float) -> Any:
    """Its pixels (h, w, 3), so many across at most."""
    from PIL import Image

    with Image.open(io.BytesIO(_bytes(uri))) as image:
        image.thumbnail((int(width), 10_000))
        return np.asarray(image.convert("RGB"))


def _bytes(uri: str) -> bytes:
    return base64.b64decode(uri.partition(",")[2])
