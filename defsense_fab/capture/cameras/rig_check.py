"""Check whether a calibration of several cameras still holds, and find out why not.

New views of a board are compared with what the calibration predicts. If they do not fit, the cause
is a board of another size, sources in another order, a lens (zoom or focus), or a camera that was
moved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...core.arrays import Bool, Float
from ...core.camera import Camera
from ...core.errors import CaptureError
from ..tags.detection import BoardView
from ..tags.tag_patterns import CharucoBoard
from ..tracking.alignment import align
from ..tracking.reconstruction import triangulate
from .intrinsics import find_board_pose

#: A board of another size, sources in another order, zoom or focus, a camera's place.
Kind = Literal["board", "order", "lens", "moved"]
PAIR_VIEWS = 4  # that two sources are compared by, before all views are used
MAX_ORDERS = 24  # orders at most that are compared by all views
MAX_REMAINING_ERROR = 0.5  # of the corners' error may be left, for a size that explains it


@dataclass(frozen=True)
class Cause:
    """Why a calibration does not hold.

    Attributes:
        kind: Kind of the cause.
        square: Side of a square by the cameras, mm, if it is not as stated.
        order: The source that belongs to each camera (v,), if they are in another order.
    """

    kind: Kind
    square: float | None = None
    order: tuple[int, ...] | None = None


@dataclass(frozen=True)
class Diagnosis:
    """Check of cameras, with its cause.

    Attributes:
        names: Names of the cameras (v,).
        check: What was measured.
        cause: Why the calibration does not hold; None if it does.
    """

    names: tuple[str, ...]
    check: RigCheck
    cause: Cause | None = None


def diagnose(
    cameras: Sequence[Camera], board: CharucoBoard, instants: Sequence[Mapping[int, BoardView]]
) -> Diagnosis:
    """Check calibrated cameras and find out why the calibration does not hold.

    Args:
        cameras: The calibrated cameras.
        board: The board.
        instants: Views of each instant by source, one source for each camera.

    Raises:
        CaptureError: If there are no views.
    """
    check, names = check_rig(cameras, board, instants), tuple(c.name for c in cameras)
    if check.holds:
        return Diagnosis(names, check)
    if _is_size_wrong(check):
        return Diagnosis(names, check, Cause("board", _square_size(board, check)))
    best_check, best_order = None, None
    for k, candidate in enumerate(_possible_orders(cameras, board, instants)):
        candidate_check = check_rig(cameras, board, _reorder(instants, candidate))
        if candidate_check.fits and (
            best_check is None
            or candidate_check.scaled_corner_error < best_check.scaled_corner_error
        ):
            best_check, best_order = candidate_check, candidate
        if k + 1 == MAX_ORDERS:
            break
    if best_check is not None:
        square = _square_size(board, best_check) if _is_size_wrong(best_check) else None
        return Diagnosis(names, check, Cause("order", square, best_order))
    return Diagnosis(
        names, check, Cause("lens" if (check.camera_errors > MAX_ERROR_PX).any() else "moved")
    )


def _is_size_wrong(check: RigCheck) -> bool:
    """Return whether another size of the board explains the errors."""
    return (
        not check.holds
        and check.fits
        and check.scaled_corner_error < MAX_REMAINING_ERROR * check.corner_error
    )


def _square_size(board: CharucoBoard, check: RigCheck) -> float:
    return check.scale * board.scale * board.square


def _reorder(
    instants: Sequence[Mapping[int, BoardView]], order: Sequence[int]
) -> list[dict[int, BoardView]]:
    """Return the views by camera, where `order` has the source of each camera."""
    return [{c: views[k] for c, k in enumerate(order) if k in views} for views in instants]


def _possible_orders(
    cameras: Sequence[Camera], board: CharucoBoard, instants: Sequence[Mapping[int, BoardView]]
) -> Iterator[tuple[int, ...]]:
    """Yield other orders of the sources, in which each two that saw the board together fit."""
    cache: dict[tuple[int, int, int, int], bool] = {}

    def fits(c: int, d: int, a: int, b: int) -> bool:
        """Whether cameras c and d are the sources a and b."""
        if (c, d, a, b) not in cache:
            shared = [{0: views[a], 1: views[b]} for views in instants if a in views and b in views]
            sample = shared[:: -(-len(shared) // PAIR_VIEWS)] if shared else []
            cache[c, d, a, b] = (
                not sample or check_rig([cameras[c], cameras[d]], board, sample).fits
            )
        return cache[c, d, a, b]

    def extend(order: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
        d = len(order)
        if d == len(cameras):
            yield order
            return
        for b in range(len(cameras)):
            if b not in order and all(fits(c, d, a, b) for c, a in enumerate(order)):
                yield from extend((*order, b))

    identity = tuple(range(len(cameras)))
    yield from (order for order in extend(()) if order != identity)


#: Limits within which a calibration holds.
MAX_ERROR_PX, MAX_ERROR_MM = 0.5, 0.3


@dataclass(frozen=True)
class RigCheck:
    """Residuals of v cameras that see a board; NaN where nothing was seen.

    Attributes:
        camera_errors: Root mean square residual of each camera alone (v,), px.
        ray_error: Root mean square distance of the rays of several cameras, px.
        corner_error: Root mean square distance of located corners from their positions on the
            board, mm.
        boards: Number of views that were used.
        scale: Size of the board by the cameras, relative to its stated size.
        scaled_corner_error: As `corner_error`, for a board of that size.
        disagreeing: Cameras without which most of what they see fits the others (v,).
    """

    camera_errors: Float
    ray_error: float
    corner_error: float
    boards: int
    scale: float
    scaled_corner_error: float
    disagreeing: Bool

    @property
    def holds(self) -> bool:
        """Whether measurements are as good as right after the calibration."""
        return self._agree and not self.corner_error > MAX_ERROR_MM

    @property
    def fits(self) -> bool:
        """Whether all views fit a board of `scale` times the stated size."""
        return self._agree and not self.scaled_corner_error > MAX_ERROR_MM

    @property
    def _agree(self) -> bool:
        cameras_agree = bool(
            (self.camera_errors[np.isfinite(self.camera_errors)] <= MAX_ERROR_PX).all()
        )
        return cameras_agree and not self.ray_error > MAX_ERROR_PX


def check_rig(
    cameras: Sequence[Camera], board: CharucoBoard, instants: Sequence[Mapping[int, BoardView]]
) -> RigCheck:
    """Check calibrated cameras by new views of a board.

    Args:
        cameras: The calibrated cameras.
        board: The board.
        instants: Views of each instant by camera.

    Raises:
        CaptureError: If there are no views.
    """
    if not instants:
        raise CaptureError(
            "the cameras never saw the board together",
            code="board-never-shared",
            where="cameras",
            action="Hold the board where all cameras see it",
        )
    camera_errors: list[list[Float]] = [[] for _ in cameras]
    ray_errors, placed_pairs = [], []
    left_out, shared = [np.zeros(len(cameras), int)], [np.zeros(len(cameras), int)]
    for views in instants:
        for c, view in views.items():
            camera_errors[c].append(_camera_residuals(cameras[c], board, view))
        if len(views) < 2:
            continue
        ids = np.unique(np.concatenate([v.ids for v in views.values()]))
        corners = np.full((len(ids), len(cameras), 4, 2), np.nan)
        for c, view in views.items():
            pixels = cameras[c].to_plane(view.corners) * cameras[c].focal + cameras[c].matrix[:2, 2]
            corners[np.searchsorted(ids, view.ids), c] = pixels[:, None]
        noise = np.tile(np.eye(2) * 0.01, (len(ids), len(cameras), 5, 1, 1))
        located = triangulate(cameras, corners, noise)
        # Corners that could not be located, or only without one of the cameras, count with the
        # largest possible error.
        is_visible = np.isfinite(corners[:, :, 0, 0])
        is_left_out = is_visible & ~located.used & located.used.any(axis=1, keepdims=True)
        left_out.append(is_left_out.sum(axis=0))
        shared.append(is_visible.sum(axis=0))
        is_shared = is_visible.sum(axis=1) >= 2
        all_agree = np.isfinite(located.miss) & ~is_left_out.any(axis=1)
        ray_errors.append(np.where(all_agree, located.miss, 2.0)[is_shared])
        points = located.points
        if np.isfinite(points[:, 0]).sum() >= 4:
            aligned = align(points[None], board.corners[ids])
            is_aligned = np.isfinite(aligned.points[0, :, 0])
            if is_aligned.any():
                pair = np.stack([aligned.points[0, is_aligned], board.corners[ids[is_aligned]]])
                placed_pairs.append(pair - pair.mean(axis=1, keepdims=True))
    measured, stated = np.concatenate([np.zeros((2, 0, 3)), *placed_pairs], axis=1)
    # The best rotation does not depend on the size, so only the size remains to be found.
    scale = float((measured * stated).sum() / (stated**2).sum()) if len(stated) else float("nan")
    return RigCheck(
        np.array([_root_mean_square(np.concatenate([np.zeros(0), *m])) for m in camera_errors]),
        _root_mean_square(np.concatenate([np.zeros(0), *ray_errors])),
        _root_mean_square(np.linalg.norm(measured - stated, axis=1)),
        len(instants),
        scale,
        _root_mean_square(np.linalg.norm(measured - scale * stated, axis=1)),
        np.sum(left_out, axis=0) > np.sum(shared, axis=0) / 2,
    )


def _camera_residuals(camera: Camera, board: CharucoBoard, view: BoardView) -> Float:
    """Return distances (k,), px, of corners from those of the board in its best pose."""
    points = board.corners[view.ids]
    pose = find_board_pose(camera, points, view.corners)
    if pose is None:
        return np.full(len(points), np.inf)
    return np.asarray(np.linalg.norm(pose[2] - view.corners, axis=1))


def _root_mean_square(values: Float) -> float:
    """Return the root mean square of values; NaN if there are none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
