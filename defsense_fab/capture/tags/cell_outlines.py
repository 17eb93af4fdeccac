"""The outlines of a picture of black and white cells.

Cells drawn one by one leave hairlines between them where a raster's pixels do not meet their edges;
one region with one outline has none.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Bool

Corner = tuple[int, int]


def outlines(black: Bool) -> list[list[Corner]]:
    """Closed polygons of corners (column, row) around the black cells of a picture (rows, columns),
    rows downwards, corners only where they turn. Filled by the even-odd rule they give the cells.
    """
    padded = np.pad(black, 1)
    follow: dict[Corner, list[Corner]] = {}
    for row, column in np.argwhere(padded).tolist():
        x, y = column - 1, row - 1
        for (dr, dc), start, end in (
            ((-1, 0), (x, y), (x + 1, y)),
            ((0, 1), (x + 1, y), (x + 1, y + 1)),
            ((1, 0), (x + 1, y + 1), (x, y + 1)),
            ((0, -1), (x, y + 1), (x, y)),
        ):
            if not padded[row + dr, column + dc]:
                follow.setdefault(start, []).append(end)
    found = []
    while follow:
        first = next(iter(follow))
        line, at = [first], _next(follow, first)
        while at != first:
            line.append(at)
            at = _next(follow, at)
        found.append(_turns(line))
    return found


def _next(follow: dict[Corner, list[Corner]], at: Corner) -> Corner:
    ways = follow[at]
    way = ways.pop()
    if not ways:
        del follow[at]
    return way


def _turns(line: list[Corner]) -> list[Corner]:
    ring = zip([line[-1], *line[:-1]], line, [*line[1:], line[0]], strict=True)
    return [b for a, b, c in ring if (b[0] - a[0]) * (c[1] - b[1]) != (b[1] - a[1]) * (c[0] - b[0])]
