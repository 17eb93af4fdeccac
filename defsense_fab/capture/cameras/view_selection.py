"""Which views of a board are worth keeping: still ones, as different from each other as can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ..tags.detection import BoardView
from ..tags.tag_patterns import CharucoBoard

#: px that corners may move from frame to frame, for a view that counts as still.
STILL = 0.6
#: Of the views, the slowest, that are looked at where few are still, and in turn while those give
#: too few views for a calibration.
_SLOW, _ENOUGH = (0.4, 0.7, 1.0), 30
_NOVEL = 0.12  # distance between descriptors of views that are different
#: Of the image, in cells of a grid: columns and rows.
GRID = (6, 4)
_PLACES = (("top", "middle", "bottom"), ("left", "centre", "right"))
_TILTS = 15.0  # of the descriptor's slant, degrees


def descriptor(view: BoardView, board: CharucoBoard, size: tuple[int, int]) -> Float:
    """Where and how the board is seen (5,): place in the image, size, and slant two ways; changes
    of one are of the same weight."""
    flat = board.corners[view.ids, :2]
    middle = flat.mean(axis=0)
    a = np.column_stack([flat - middle, np.ones(len(flat))])
    H, *_ = np.linalg.lstsq(a, view.corners, rcond=None)
    width = float(max(size))
    place = view.corners.mean(axis=0) / width
    stretch = H[:2].T  # px per mm
    u, s, vt = np.linalg.svd(stretch)
    slant = float(np.arccos(np.clip(s[1] / s[0], 0, 1)))
    turn = u @ vt
    way = u[:, 1] if turn[0, 0] >= 0 else -u[:, 1]
    # A circle looks the same tilted either way; how its far side shrinks tells them apart.
    line = (flat - middle) @ vt[1]
    along = (view.corners - view.corners.mean(axis=0)) @ u[:, 1]
    bend = np.polyfit(line, along, 2)[0] if np.ptp(line) > 0 else 0.0
    both = slant / np.radians(45) * way * (1.0 if bend >= 0 else -1.0)
    return np.array([*place, 0.5 * np.log(s[0] * board.square / width * 10), *(0.5 * both)])


def motion(views: Sequence[BoardView | None]) -> Float:
    """Mean shift (t,) px of the corners from the frame before, or to the one after where that is
    less; infinite where there is neither."""
    step = np.full(len(views) + 1, np.inf)
    for k in range(1, len(views)):
        a, b = views[k - 1], views[k]
        if a is None or b is None:
            continue
        _, i, j = np.intersect1d(a.ids, b.ids, return_indices=True)
        if len(i):
            step[k] = float(np.linalg.norm(b.corners[j] - a.corners[i], axis=1).mean())
    return np.asarray(np.minimum(step[:-1], step[1:]))


def choose(
    descriptors: Float, moves: Float, most: int, *, stills: bool = False, moving: bool = False
) -> Int:
    """At most so many of n views, in their order: slow ones (all, where they are `stills`), by
    farthest-point sampling of their `descriptors` (n, 5). With `moving`, faster ones are taken
    where the slow ones are few and alike: a board that is always in motion, before a short
    exposure, tells as much of a camera by itself."""
    if not len(descriptors):
        return np.zeros(0, np.int64)
    slow = np.ones(len(moves), bool) if stills else moves <= STILL
    if slow.sum() >= min(most, len(moves)) / 2:
        chosen = _spread(descriptors, np.flatnonzero(slow), most, stills)
        if not moving or len(chosen) >= min(_ENOUGH, most):
            return chosen
    finite = np.where(np.isfinite(moves), moves, np.nanmax(moves[np.isfinite(moves)], initial=1))
    for share in _SLOW if moving else _SLOW[:1]:
        limit = max(STILL, float(np.quantile(finite, share)))
        chosen = _spread(descriptors, np.flatnonzero(finite <= limit), most, stills)
        if len(chosen) >= min(_ENOUGH, most):
            break
    return chosen


def _spread(descriptors: Float, rows: Int, most: int, stills: bool) -> Int:
    """At most so many of the views `rows` (k,), as different from each other as can be."""
    middle = descriptors[rows].mean(axis=0)
    chosen = [int(rows[np.linalg.norm(descriptors[rows] - middle, axis=1).argmin()])]
    gap = np.full(len(rows), np.inf)
    while len(chosen) < min(most, len(rows)):
        gap = np.minimum(gap, np.linalg.norm(descriptors[rows] - descriptors[chosen[-1]], axis=1))
        best = int(gap.argmax())
        alike = gap[best] < _NOVEL / 4 and len(chosen) >= _ENOUGH
        if gap[best] < 1e-9 or (alike and not stills):
            break
        chosen.append(int(rows[best]))
    return np.sort(np.array(chosen))


def is_new(view: Float, kept: Sequence[Float]) -> bool:
    """Whether a descriptor differs from all that were kept."""
    return all(float(np.linalg.norm(view - k)) > _NOVEL for k in kept)


@dataclass(frozen=True)
class Coverage:
    """How much views show of the image: `cells` (rows, columns), corners in each of a grid; and
    `hints`, what to do next, most useful first."""

    cells: Int
    hints: tuple[str, ...]

    @property
    def fraction(self) -> float:
        """Of the cells that have corners."""
        return float((self.cells > 0).mean())


def coverage(
    views: Sequence[BoardView], board: CharucoBoard, size: tuple[int, int], wanted: int
) -> Coverage:
    """Of an image of `size` px by the views of a board, of which so many are wanted."""
    columns, rows = GRID
    cells = np.zeros((rows, columns), np.int64)
    for view in views:
        x = np.clip((view.corners[:, 0] / size[0] * columns).astype(int), 0, columns - 1)
        y = np.clip((view.corners[:, 1] / size[1] * rows).astype(int), 0, rows - 1)
        np.add.at(cells, (y, x), 1)
    hints = []
    seen = cells > 0
    corners = {
        (0, 0): seen[: rows // 2, : columns // 3], (0, 2): seen[: rows // 2, -(columns // 3) :],
        (2, 0): seen[-(rows // 2) :, : columns // 3],
        (2, 2): seen[-(rows // 2) :, -(columns // 3) :],
    }  # fmt: skip
    for (y, x), part in sorted(corners.items(), key=lambda kv: kv[1].mean()):
        if part.mean() < 0.75:
            hints.append(f"hold the board at the {_PLACES[0][y]} {_PLACES[1][x]} of the picture")
    if views:
        d = np.array([descriptor(v, board, size) for v in views])
        slant = np.degrees(np.radians(45) * 2 * np.abs(d[:, 3:]))
        for axis, words in ((0, "left or right"), (1, "up or down")):
            if (slant[:, axis] > _TILTS).sum() < 3:
                hints.append(f"tilt the board {words}, by 30 to 45 degrees")
        if np.ptp(d[:, 2]) < 0.2:
            hints.append("hold the board nearer, then farther away")
    if len(views) < wanted:
        hints.append(f"take {wanted - len(views)} more views")
    return Coverage(cells, tuple(hints))
