"""A fisheye's focal lengths, principal point and four coefficients, from views of a board.

OpenCV's fit begins; least squares over all parameters, poses of the board among them, end it and
tell the standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Float
from ...core.camera import distort
from ...core.curves.rotation_vectors import rotations
from ...core.errors import CaptureError
from ..tags.board_detection import BoardView
from ..tags.charuco_board import CharucoBoard

_LENS = 8  # fx, fy, cx, cy, k1 to k4
_FLAGS = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW | cv2.CALIB_USE_INTRINSIC_GUESS
_WIDE = np.radians(150)  # of the picture's larger side, to begin with


@dataclass(frozen=True)
class SolvedLens:
    """`matrix` (3, 3), `distortions`, root mean square `error` px, standard deviations `sigma`
    (9,) of fx, fy, cx, cy and the coefficients."""

    matrix: Float
    distortions: Float
    error: float
    sigma: Float


def solve_fisheye(
    size: tuple[int, int], board: CharucoBoard, views: Sequence[BoardView]
) -> SolvedLens:
    """From chosen views. Raises CaptureError where no lens can be computed from them."""
    points = [board.corners[v.ids] for v in views]
    K = np.eye(3)
    K[0, 0] = K[1, 1] = max(size) / _WIDE
    K[:2, 2] = (np.array(size) - 1) / 2
    try:
        _, K, D, turns, shifts = cv2.fisheye.calibrate(
            [p[None].astype(np.float64) for p in points],
            [v.corners[None].astype(np.float64) for v in views], size, K, np.zeros((4, 1)),
            flags=_FLAGS,
        )  # fmt: skip
    except cv2.error as problem:
        raise CaptureError(
            f"no fisheye can be computed from the views ({problem.err}); take others with more"
            " tilt, out to the picture's corners, or calibrate without --lens fisheye",
            code="calibration-unsolvable",
        ) from None
    poses = np.column_stack([np.reshape(turns, (-1, 3)), np.reshape(shifts, (-1, 3))])
    start = np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2]], np.ravel(D), poses.ravel()])
    owner = np.repeat(np.arange(len(views)), [len(p) for p in points])
    flat, seen = np.concatenate(points), np.concatenate([v.corners for v in views])

    def miss(x: Float) -> Float:
        pose = x[_LENS:].reshape(-1, 6)[owner]
        at = np.einsum("nij,nj->ni", rotations(pose[:, :3]), flat) + pose[:, 3:]
        shown = distort(at[:, :2] / at[:, 2:], x[4:_LENS], fisheye=True)[0]
        return np.asarray((shown * x[:2] + x[2:4] - seen).ravel())

    scale = np.maximum(np.abs(start), 1e-2)
    found = least_squares(miss, start, x_scale=scale, max_nfev=20)
    x, r = found.x, found.fun
    if not np.isfinite(x).all():
        raise CaptureError(
            "no fisheye can be computed from the views; take others with more tilt",
            code="calibration-unsolvable",
        )
    noise = (r @ r) / max(len(r) - len(x), 1)
    covariance = noise * np.linalg.pinv(found.jac.T @ found.jac)
    sigma = np.append(np.sqrt(np.maximum(np.diag(covariance)[:_LENS], 0.0)), 0.0)
    matrix = np.array([[x[0], 0, x[2]], [0, x[1], x[3]], [0, 0, 1.0]])
    error = float(np.sqrt(2 * np.mean(r * r)))
    return SolvedLens(matrix, np.array(x[4:_LENS]), error, sigma)
