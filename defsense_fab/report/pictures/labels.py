"""Labels beside a drawing, with lines to what they name: they cover neither it nor each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...core.arrays import Bool, Float, Int
from .sheet import INK, SMALL, Place, Sheet, extent

#: Pixels between a label and the drawing.
GAP = 26.0
#: Labels may stand at any height.
ANYWHERE = (-np.inf, np.inf)
_LEAST = 6  # pixels: of a thing that shows less, nothing to point at is taken to be seen


@dataclass(frozen=True)
class Placed:
    """Of n labels: `ends` (n, 2) pixels where their lines begin, and which stand to the `left`."""

    ends: Float
    left: Bool


def places(
    anchors: Float, size: Place, heights: Float | float, limits: tuple[float, float] = ANYWHERE
) -> Placed:
    """Where labels of `heights` (n,) pixels stand in two columns beside a drawing of `size` (width,
    height) pixels for `anchors` (n, 2) in it: half of them on either side, evenly spread, as near
    as they can be to what they name, between the `limits` (pixels, downwards), and no two lines
    cross."""
    anchors = np.asarray(anchors, float).reshape(-1, 2)
    tall = np.broadcast_to(np.asarray(heights, float), len(anchors))
    order = np.argsort(anchors[:, 0], kind="stable")
    left = np.zeros(len(anchors), bool)
    left[order[: len(anchors) // 2]] = True
    if len(anchors) == 1:
        left[0] = anchors[0, 0] < size[0] / 2
    ends = np.zeros((len(anchors), 2))
    for is_left in (True, False):
        of = np.flatnonzero(left == is_left)
        some: Int = of[np.argsort(anchors[of, 1], kind="stable")]
        wanted = anchors[some, 1]
        x = -GAP if is_left else size[0] + GAP
        y = spread(wanted, tall[some], limits)
        some = _uncrossed(anchors, some, np.stack([np.full(len(y), x), y], axis=1))
        ends[some, 0], ends[some, 1] = x, spread(wanted, tall[some], limits)
    return Placed(ends, left)


def spread(wanted: Float, heights: Float | float, limits: tuple[float, float] = ANYWHERE) -> Float:
    """Middles (n,), in rising order, of labels of `heights` (n,) that do not overlap, and together
    are as near to those `wanted` (n,), in rising order, as can be (least squares) between the
    `limits`; if these have no room for all, they end at the upper one."""
    if not len(wanted):
        return np.zeros(0)
    tall = np.broadcast_to(np.asarray(heights, float), len(wanted))
    least = np.concatenate([[0.0], np.cumsum((tall[1:] + tall[:-1]) / 2)])  # from the first one
    blocks: list[list[float]] = []  # sum of wanted places of the first label, count
    for w, away in zip(wanted, least, strict=True):
        blocks.append([float(w) - float(away), 1])
        while len(blocks) > 1 and blocks[-2][0] / blocks[-2][1] > blocks[-1][0] / blocks[-1][1]:
            total, count = blocks.pop()
            blocks[-1][0] += total
            blocks[-1][1] += count
    first = [total / count for total, count in blocks for _ in range(int(count))]
    low, high = limits[0] + tall[0] / 2, limits[1] - tall[-1] / 2 - least[-1]
    return np.asarray(np.minimum(np.maximum(first, low), high) + least)


def _uncrossed(anchors: Float, some: Int, ends: Float) -> Int:
    """The order of `some` labels at `ends` in which no two lines cross: swapping two that do makes
    them shorter together, so this comes to an end."""
    some = some.copy()
    swapped = True
    while swapped:
        swapped = False
        for i in range(len(some)):
            for j in range(i + 1, len(some)):
                a, b = anchors[some[i]], anchors[some[j]]
                now = np.linalg.norm(a - ends[i]) + np.linalg.norm(b - ends[j])
                then = np.linalg.norm(a - ends[j]) + np.linalg.norm(b - ends[i])
                if then < now - 1e-9:
                    some[[i, j]] = some[[j, i]]
                    swapped = True
    return some


def spot(seen: Bool) -> tuple[float, float] | None:
    """The pixel of a region (h, w) that is deepest inside of it; None where next to nothing is
    seen."""
    if seen.sum() < _LEAST:
        return None
    rows, columns = (np.flatnonzero(seen.any(axis=a)) for a in (1, 0))
    low = np.array([rows[0], columns[0]])
    cut = seen[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    deep = ndimage.distance_transform_cdt(np.pad(cut, 1), metric="chessboard")[1:-1, 1:-1]
    # Of those as deep as can be the one nearest to their middle.
    best = np.argwhere(deep >= 0.8 * deep.max())
    at = best[np.linalg.norm(best - best.mean(0), axis=1).argmin()] + low
    return float(at[1]), float(at[0])


def widths(names: Sequence[str], anchors: Float, size: Place) -> tuple[float, float]:
    """How much room labels need to the left and to the right of a drawing, pixels."""
    left = places(anchors, size, 1.0).left
    wide = [0.0, 0.0]
    for name, is_left in zip(names, left, strict=True):
        k = 0 if is_left else 1
        wide[k] = max(wide[k], room([name]))
    return wide[0], wide[1]


def room(names: Iterable[str]) -> float:
    """Pixels that the widest of some labels needs beside a drawing."""
    return max((extent(n, SMALL)[0] for n in names), default=0.0) + GAP + 12


def write(
    sheet: Sheet,
    names: Sequence[str],
    anchors: Float,
    corner: Place,
    size: Place,
    colors: Sequence[str],
    below: float = 0.0,
) -> None:
    """Names beside a drawing of `size` pixels that has its top left at `corner`, for `anchors`
    (n, 2) pixels in it; a bar in the colour of a name's part stands beside it. They keep clear of
    the `below` lowest pixels of the sheet."""
    corner = np.asarray(corner, float)
    limits = (-corner[1], sheet.size[1] - below - corner[1])
    placed = places(anchors, size, 1.5 * SMALL, limits)
    ends = placed.ends + corner
    for at, end in zip(np.asarray(anchors) + corner, ends, strict=True):
        sheet.line([end, at], "white", 4.5)
        sheet.dot(at, "white", 6)
    for name, color, at, end, left in zip(
        names, colors, np.asarray(anchors) + corner, ends, placed.left, strict=True
    ):
        sheet.line([end, at], INK, 1.5)
        sheet.dot(at, INK, 4)
        way = -1 if left else 1
        x, y = end
        bar = x + 4 * way
        sheet.line([(bar, y - SMALL / 2), (bar, y + SMALL / 2)], color, 6)
        sheet.text((x + 11 * way, y), name, SMALL, anchor="rm" if left else "lm")
