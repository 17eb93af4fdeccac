"""Select views of a board for calibration: still ones that differ from each other as much as
possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ..tags.detection import BoardView
from ..tags.tag_patterns import CharucoBoard

MAX_STILL_MOTION_PX = 0.6  # of corners from frame to frame
#: Shares of the slowest views that are used, in turn, while fewer views are still than a
#: calibration needs.
SLOW_SHARES, ENOUGH_VIEWS = (0.4, 0.7, 1.0), 30
MIN_NOVELTY = 0.12  # distance between descriptions of different views
GRID = (6, 4)  # columns and rows of cells in the image
_PLACE_NAMES = (("top", "middle", "bottom"), ("left", "centre", "right"))
MIN_TILT_DEG = 15.0


def describe_view(view: BoardView, board: CharucoBoard, size: tuple[int, int]) -> Float:
    """Describe where and how a view shows the board.

    Args:
        view: View of the board.
        board: The board.
        size: Width and height of the image, px.

    Returns:
        Position in the image, size, and tilt in two directions (5,), scaled so that a change of one
        matters as much in each.
    """
    board_points = board.corners[view.ids, :2]
    center = board_points.mean(axis=0)
    affine = np.column_stack([board_points - center, np.ones(len(board_points))])
    H, *_ = np.linalg.lstsq(affine, view.corners, rcond=None)
    width = float(max(size))
    position = view.corners.mean(axis=0) / width
    stretch = H[:2].T  # px per mm
    u, s, vt = np.linalg.svd(stretch)
    slant = float(np.arccos(np.clip(s[1] / s[0], 0, 1)))
    rotation = u @ vt
    direction = u[:, 1] if rotation[0, 0] >= 0 else -u[:, 1]
    # A circle looks the same tilted either way, but its far side shrinks.
    distance = (board_points - center) @ vt[1]
    image_distance = (view.corners - view.corners.mean(axis=0)) @ u[:, 1]
    curvature = np.polyfit(distance, image_distance, 2)[0] if np.ptp(distance) > 0 else 0.0
    tilt = slant / np.radians(45) * direction * (1.0 if curvature >= 0 else -1.0)
    return np.array([*position, 0.5 * np.log(s[0] * board.square / width * 10), *(0.5 * tilt)])


def corner_motion(views: Sequence[BoardView | None]) -> Float:
    """Return the mean motion of the corners in each frame (t,), px.

    It is the smaller of those from the previous frame and to the next; infinite without either.
    """
    step = np.full(len(views) + 1, np.inf)
    for k in range(1, len(views)):
        previous, current = views[k - 1], views[k]
        if previous is None or current is None:
            continue
        _, i, j = np.intersect1d(previous.ids, current.ids, return_indices=True)
        if len(i):
            step[k] = float(np.linalg.norm(current.corners[j] - previous.corners[i], axis=1).mean())
    return np.asarray(np.minimum(step[:-1], step[1:]))


def choose_views(
    descriptors: Float,
    motions: Float,
    max_views: int,
    *,
    are_stills: bool = False,
    allow_motion: bool = False,
) -> Int:
    """Choose views by farthest-point sampling of their descriptions.

    Args:
        descriptors: Descriptions of the views (n, 5).
        motions: Motion of the corners in each view (n,), px.
        max_views: Largest number of views.
        are_stills: Whether all views are stills, so their motion does not matter.
        allow_motion: Whether faster views are used if the slow ones are few and alike. A board that
            is always in motion calibrates a single camera as well, if the exposure is short.

    Returns:
        Indices of the views, in their order.
    """
    if not len(descriptors):
        return np.zeros(0, np.int64)
    is_slow = np.ones(len(motions), bool) if are_stills else motions <= MAX_STILL_MOTION_PX
    if is_slow.sum() >= min(max_views, len(motions)) / 2:
        chosen = _farthest_points(descriptors, np.flatnonzero(is_slow), max_views, are_stills)
        if not allow_motion or len(chosen) >= min(ENOUGH_VIEWS, max_views):
            return chosen
    finite = np.where(
        np.isfinite(motions), motions, np.nanmax(motions[np.isfinite(motions)], initial=1)
    )
    for share in SLOW_SHARES if allow_motion else SLOW_SHARES[:1]:
        limit = max(MAX_STILL_MOTION_PX, float(np.quantile(finite, share)))
        chosen = _farthest_points(
            descriptors, np.flatnonzero(finite <= limit), max_views, are_stills
        )
        if len(chosen) >= min(ENOUGH_VIEWS, max_views):
            break
    return chosen


def _farthest_points(descriptors: Float, rows: Int, max_views: int, are_stills: bool) -> Int:
    """Return at most `max_views` of the views `rows` (k,), as different from each other as
    possible.
    """
    center = descriptors[rows].mean(axis=0)
    chosen = [int(rows[np.linalg.norm(descriptors[rows] - center, axis=1).argmin()])]
    distance = np.full(len(rows), np.inf)
    while len(chosen) < min(max_views, len(rows)):
        distance = np.minimum(
            distance, np.linalg.norm(descriptors[rows] - descriptors[chosen[-1]], axis=1)
        )
        best = int(distance.argmax())
        is_alike = distance[best] < MIN_NOVELTY / 4 and len(chosen) >= ENOUGH_VIEWS
        if distance[best] < 1e-9 or (is_alike and not are_stills):
            break
        chosen.append(int(rows[best]))
    return np.sort(np.array(chosen))


def is_new(description: Float, known: Sequence[Float]) -> bool:
    """Return whether a description differs from all known ones."""
    return all(float(np.linalg.norm(description - other)) > MIN_NOVELTY for other in known)


@dataclass(frozen=True)
class Coverage:
    """How much of the image views cover.

    Attributes:
        cells: Number of corners in each cell of a grid (rows, columns).
        hints: What to do next, most useful first.
    """

    cells: Int
    hints: tuple[str, ...]

    @property
    def fraction(self) -> float:
        """Share of the cells that have corners."""
        return float((self.cells > 0).mean())


def measure_coverage(
    views: Sequence[BoardView], board: CharucoBoard, size: tuple[int, int], target: int
) -> Coverage:
    """Measure how much of the image views of a board cover.

    Args:
        views: Views of the board.
        board: The board.
        size: Width and height of the image, px.
        target: Number of views needed.
    """
    columns, rows = GRID
    cells = np.zeros((rows, columns), np.int64)
    for view in views:
        x = np.clip((view.corners[:, 0] / size[0] * columns).astype(int), 0, columns - 1)
        y = np.clip((view.corners[:, 1] / size[1] * rows).astype(int), 0, rows - 1)
        np.add.at(cells, (y, x), 1)
    hints = []
    has_corners = cells > 0
    corners = {
        (0, 0): has_corners[: rows // 2, : columns // 3],
        (0, 2): has_corners[: rows // 2, -(columns // 3) :],
        (2, 0): has_corners[-(rows // 2) :, : columns // 3],
        (2, 2): has_corners[-(rows // 2) :, -(columns // 3) :],
    }
    for (y, x), part in sorted(corners.items(), key=lambda kv: kv[1].mean()):
        if part.mean() < 0.75:
            hints.append(
                f"hold the board at the {_PLACE_NAMES[0][y]} {_PLACE_NAMES[1][x]} of the picture"
            )
    if views:
        descriptions = np.array([describe_view(v, board, size) for v in views])
        slant = np.degrees(np.radians(45) * 2 * np.abs(descriptions[:, 3:]))
        for axis, directions in ((0, "left or right"), (1, "up or down")):
            if (slant[:, axis] > MIN_TILT_DEG).sum() < 3:
                hints.append(f"tilt the board {directions}, by 30 to 45 degrees")
        if np.ptp(descriptions[:, 2]) < 0.2:
            hints.append("hold the board nearer, then farther away")
    if (missing := target - len(views)) > 0:
        hints.append(f"take {missing} more view{'s' * (missing > 1)}")
    return Coverage(cells, tuple(hints))
