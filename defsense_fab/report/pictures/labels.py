"""Place labels next to a drawing, so that labels and lines cover neither it nor each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...core.arrays import Bool, Float, Int
from .sheet import INK, SMALL, Place, Sheet, extent

#: Pixels between a label and the drawing.
GAP = 26.0
#: Limits of labels that may be at any height.
ANYWHERE = (-np.inf, np.inf)
_MIN_VISIBLE_PX = 6  # of a region; a smaller one is hidden


@dataclass(frozen=True)
class Placed:
    """Places of n labels.

    Attributes:
        ends: Where the labels' lines end (n, 2), pixels.
        left: Whether each label is in the left column (n,).
    """

    ends: Float
    left: Bool


def places(
    anchors: Float, size: Place, heights: Float | float, limits: tuple[float, float] = ANYWHERE
) -> Placed:
    """Place labels in two columns next to a drawing.

    Half of the labels are in each column, as close as possible to their anchors, and no two lines
    cross.

    Args:
        anchors: What the labels name (n, 2), pixels in the drawing.
        size: Width and height of the drawing, pixels.
        heights: Height of each label (n,), or of all, pixels.
        limits: Highest and lowest place of labels, pixels downwards.

    Returns:
        The places.
    """
    anchors = np.asarray(anchors, float).reshape(-1, 2)
    tall = np.broadcast_to(np.asarray(heights, float), len(anchors))
    order = np.argsort(anchors[:, 0], kind="stable")
    left = np.zeros(len(anchors), bool)
    left[order[: len(anchors) // 2]] = True
    if len(anchors) == 1:
        left[0] = anchors[0, 0] < size[0] / 2
    ends = np.zeros((len(anchors), 2))
    for is_left in (True, False):
        members = np.flatnonzero(left == is_left)
        column: Int = members[np.argsort(anchors[members, 1], kind="stable")]
        preferred = anchors[column, 1]
        x = -GAP if is_left else size[0] + GAP
        y = spread(preferred, tall[column], limits)
        column = _order_without_crossings(
            anchors, column, np.stack([np.full(len(y), x), y], axis=1)
        )
        ends[column, 0], ends[column, 1] = x, spread(preferred, tall[column], limits)
    return Placed(ends, left)


def spread(
    preferred: Float, heights: Float | float, limits: tuple[float, float] = ANYWHERE
) -> Float:
    """Move labels apart until they do not overlap.

    Args:
        preferred: Preferred middles (n,) of the labels, in rising order, pixels.
        heights: Height of each label (n,), or of all, pixels.
        limits: Lowest and highest place; labels that do not fit end at the upper one.

    Returns:
        Middles (n,), in rising order, as close as possible to the preferred ones (least squares).
    """
    if not len(preferred):
        return np.zeros(0)
    tall = np.broadcast_to(np.asarray(heights, float), len(preferred))
    offsets = np.concatenate(
        [[0.0], np.cumsum((tall[1:] + tall[:-1]) / 2)]
    )  # distances from the first label
    blocks: list[list[float]] = []  # sum of preferred places of the first label, count
    for w, offset in zip(preferred, offsets, strict=True):
        blocks.append([float(w) - float(offset), 1])
        while len(blocks) > 1 and blocks[-2][0] / blocks[-2][1] > blocks[-1][0] / blocks[-1][1]:
            total, count = blocks.pop()
            blocks[-1][0] += total
            blocks[-1][1] += count
    first = [total / count for total, count in blocks for _ in range(int(count))]
    low, high = limits[0] + tall[0] / 2, limits[1] - tall[-1] / 2 - offsets[-1]
    return np.asarray(np.minimum(np.maximum(first, low), high) + offsets)


def _order_without_crossings(anchors: Float, column: Int, ends: Float) -> Int:
    """Return the order of labels in which no two lines cross.

    Swapping two crossing lines makes them shorter together, so the loop ends.
    """
    column = column.copy()
    has_swapped = True
    while has_swapped:
        has_swapped = False
        for i in range(len(column)):
            for j in range(i + 1, len(column)):
                a, b = anchors[column[i]], anchors[column[j]]
                length = np.linalg.norm(a - ends[i]) + np.linalg.norm(b - ends[j])
                swapped_length = np.linalg.norm(a - ends[j]) + np.linalg.norm(b - ends[i])
                if swapped_length < length - 1e-9:
                    column[[i, j]] = column[[j, i]]
                    has_swapped = True
    return column


def spot(region: Bool) -> tuple[float, float] | None:
    """Return the pixel (x, y) deepest inside a region, or None if the region is too small.

    Args:
        region: Mask (h, w) of the region.
    """
    if region.sum() < _MIN_VISIBLE_PX:
        return None
    rows, columns = (np.flatnonzero(region.any(axis=a)) for a in (1, 0))
    low = np.array([rows[0], columns[0]])
    cropped = region[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    depth = ndimage.distance_transform_cdt(np.pad(cropped, 1), metric="chessboard")[1:-1, 1:-1]
    # Of the deepest pixels, take the one closest to their middle.
    best = np.argwhere(depth >= 0.8 * depth.max())
    at = best[np.linalg.norm(best - best.mean(0), axis=1).argmin()] + low
    return float(at[1]), float(at[0])


def widths(names: Sequence[str], anchors: Float, size: Place) -> tuple[float, float]:
    """Return the widths that labels need to the left and to the right of a drawing, pixels."""
    left = places(anchors, size, 1.0).left
    widest = [0.0, 0.0]
    for name, is_left in zip(names, left, strict=True):
        k = 0 if is_left else 1
        widest[k] = max(widest[k], room([name]))
    return widest[0], widest[1]


def room(names: Iterable[str]) -> float:
    """Return the width that the widest of some labels needs next to a drawing, pixels."""
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
    """Write labels next to a drawing, with lines to their anchors and colored bars.

    Args:
        sheet: The sheet.
        names: Texts of the labels.
        anchors: What the labels name (n, 2), pixels in the drawing.
        corner: Top left of the drawing on the sheet, pixels.
        size: Width and height of the drawing, pixels.
        colors: Colors of the labels' bars.
        below: Height at the bottom of the sheet that stays free, pixels.
    """
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
        direction = -1 if left else 1
        x, y = end
        bar = x + 4 * direction
        sheet.line([(bar, y - SMALL / 2), (bar, y + SMALL / 2)], color, 6)
        sheet.text((x + 11 * direction, y), name, SMALL, anchor="rm" if left else "lm")
