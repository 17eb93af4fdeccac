"""Draw pictures in a terminal, with two pixels per character."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.color import Color
from rich.style import Style
from rich.text import Text

from ...core.arrays import Float

RGB = tuple[int, int, int]
GREEN, YELLOW = (60, 220, 90), (240, 200, 60)


def picture(
    image: NDArray[np.uint8],
    width: int,
    marks: Sequence[tuple[Float, RGB]] = (),
    labels: Sequence[tuple[Float, str]] = (),
) -> list[Text]:
    """Draw an image as rows of characters.

    Args:
        image: Gray (h, w) or BGR (h, w, 3).
        width: Number of characters per row.
        marks: Closed outlines or single points (k, 2) in px, with their colors.
        labels: Positions (2,) in px, with their texts.
    """
    h, w = image.shape[:2]
    height = max(2, round(width * h / w / 2) * 2)
    small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    if small.ndim == 2:
        small = np.repeat(small[:, :, None], 3, axis=2)
    small = np.ascontiguousarray(small[:, :, ::-1])
    scale = np.array([width / w, height / h])
    for points, color in marks:
        at = np.round((np.asarray(points) + 0.5) * scale - 0.5).astype(np.int32)
        if len(at) > 2:
            cv2.polylines(small, [at], True, color, 1)
        else:
            for x, y in at:
                if 0 <= x < width and 0 <= y < height:
                    small[y, x] = color
    rows = [_row(small[2 * k], small[2 * k + 1]) for k in range(height // 2)]
    for place, word in labels:
        x, y = int(place[0] * scale[0]), int(place[1] * scale[1]) // 2
        if 0 <= y < len(rows) and 0 <= x <= width - len(word):
            after = rows[y][x + len(word) :]
            rows[y] = Text.assemble(rows[y][:x], (word, "bold white on blue"), after)
    return rows


def _row(above: NDArray[np.uint8], below: NDArray[np.uint8]) -> Text:
    out = Text()
    for a, b in zip(above.tolist(), below.tolist(), strict=True):
        out.append("▀", Style(color=Color.from_rgb(*a), bgcolor=Color.from_rgb(*b)))
    return out
