"""Panels of one scale arranged in a picture: what fits, as large as it can be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

#: Pixels that a picture has across at most.
WIDTH = 1100


@dataclass(frozen=True)
class Panel:
    """What a drawing needs: `size` (2,) mm, and `rim` pixels around it to the left, top, right and
    bottom, for what is written there; it is at least `least` pixels wide, rim and all."""

    size: Float
    rim: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    least: float = 0.0

    def pixels(self, scale: float) -> Float:
        """Width and height at so many pixels a mm, with the rim."""
        left, top, right, bottom = self.rim
        wide, high = np.asarray(self.size) * scale + [left + right, top + bottom]
        return np.array([max(wide, self.least), high])


@dataclass(frozen=True)
class Arrangement:
    """`scale` in pixels a mm, the `size` of the whole in pixels, and the top left corner (2,) of
    the room of each panel and the room's size (2,)."""

    scale: float
    size: tuple[float, float]
    corners: tuple[Float, ...]
    rooms: tuple[Float, ...]


#: Panels by their number in rows, which stand below each other.
Rows = Sequence[Sequence[int]]
_THREE: tuple[Rows, ...] = (((0, 1, 2),), ((0,), (1, 2)), ((0,), (1,), (2,)), ((0, 1), (2,)))
_WAYS: dict[int, tuple[Rows, ...]] = {1: (((0,),),), 2: (((0, 1),), ((0,), (1,))), 3: _THREE}
_SPACE = 24.0


def arranged(
    panels: Sequence[Panel], width: float, height: float, most: float = np.inf
) -> Arrangement:
    """Up to three panels in rows or columns, whichever lets them be largest, in a picture of at
    most so many pixels; `most` is the largest scale."""
    found = [_in_rows(panels, rows, width, height, most) for rows in _WAYS[len(panels)]]
    return max(found, key=lambda a: (round(a.scale, 6), -a.size[0] * a.size[1]))


def _in_rows(
    panels: Sequence[Panel], rows: Rows, width: float, height: float, most: float
) -> Arrangement:
    def need(scale: float) -> Float:
        sizes = [[panels[i].pixels(scale) for i in row] for row in rows]
        wide = max(sum(s[0] for s in row) + _SPACE * (len(row) - 1) for row in sizes)
        high = sum(max(s[1] for s in row) for row in sizes) + _SPACE * (len(rows) - 1)
        return np.array([wide, high])

    scale = _largest(lambda s: bool((need(s) <= [width, height]).all()), most)
    total = need(scale)
    corners: dict[int, Float] = {}
    rooms: dict[int, Float] = {}
    y = 0.0
    for row in rows:
        sizes = [panels[i].pixels(scale) for i in row]
        high = max(s[1] for s in sizes)
        spare = total[0] - sum(s[0] for s in sizes)
        x, gap = spare / (len(row) + 1), spare / (len(row) + 1)
        if len(row) > 1 and gap < _SPACE:
            x, gap = 0.0, spare / (len(row) - 1)
        for i, size in zip(row, sizes, strict=True):
            corners[i], rooms[i] = np.array([x, y + high - size[1]]), size
            x += size[0] + gap
        y += high + _SPACE
    order = range(len(panels))
    return Arrangement(
        scale,
        (float(total[0]), float(total[1])),
        tuple(corners[i] for i in order),
        tuple(rooms[i] for i in order),
    )


def _largest(fits: Callable[[float], bool], most: float) -> float:
    """The largest scale that fits (bisection); next to nothing where none does."""
    low, high = 1e-6, min(most, 1e3)
    if fits(high):
        return high
    for _ in range(40):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low
