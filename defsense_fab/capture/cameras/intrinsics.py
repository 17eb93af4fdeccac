"""Calibrate a camera from views of a board (Zhang 2000).

Views that fit much worse than the others (blurred, or with a bent board) are left out. The third
radial coefficient and non-square pixels are used only if they improve the fit enough (Bayesian
information criterion).

A fisheye is fitted by OpenCV first. Least squares over all parameters, with the poses of the board,
then gives the result and the standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Bool, Float
from ...core.camera import Camera, distort
from ...core.errors import CaptureError
from ...core.rotations import rotation_matrices
from ..tags.detection import BoardView
from ..tags.tag_patterns import CharucoBoard

LENS_PARAMETERS = 8  # fx, fy, cx, cy, k1 to k4
_FISHEYE_FLAGS = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW | cv2.CALIB_USE_INTRINSIC_GUESS
FIRST_FIELD_OF_VIEW = np.radians(150)  # of the larger side of the image


@dataclass(frozen=True)
class SolvedLens:
    """Parameters of a lens.

    Attributes:
        matrix: Camera matrix (3, 3).
        distortions: Distortion coefficients.
        error: Root mean square residual, px.
        sigma: Standard deviations (9,) of fx, fy, cx, cy and the coefficients.
    """

    matrix: Float
    distortions: Float
    error: float
    sigma: Float


def solve_fisheye(
    size: tuple[int, int], board: CharucoBoard, views: Sequence[BoardView]
) -> SolvedLens:
    """Fit a fisheye to views of a board.

    Raises:
        CaptureError: If no lens can be computed from them.
    """
    points = [board.corners[v.ids] for v in views]
    K = np.eye(3)
    K[0, 0] = K[1, 1] = max(size) / FIRST_FIELD_OF_VIEW
    K[:2, 2] = (np.array(size) - 1) / 2
    try:
        _, K, D, board_rotations, translations = cv2.fisheye.calibrate(
            [p[None].astype(np.float64) for p in points],
            [v.corners[None].astype(np.float64) for v in views],
            size,
            K,
            np.zeros((4, 1)),
            flags=_FISHEYE_FLAGS,
        )
    except cv2.error as problem:
        raise CaptureError(
            f"no fisheye can be computed from the views ({problem.err})",
            code="calibration-unsolvable",
            where="calibration",
            action=(
                "Take views with more tilt, out to the corners of the image, or calibrate a lens"
                " that is not a fisheye"
            ),
        ) from None
    poses = np.column_stack(
        [np.reshape(board_rotations, (-1, 3)), np.reshape(translations, (-1, 3))]
    )
    start = np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2]], np.ravel(D), poses.ravel()])
    view_of_corner = np.repeat(np.arange(len(views)), [len(p) for p in points])
    board_corners, corners = np.concatenate(points), np.concatenate([v.corners for v in views])

    def miss(x: Float) -> Float:
        pose = x[LENS_PARAMETERS:].reshape(-1, 6)[view_of_corner]
        in_camera = (
            np.einsum("nij,nj->ni", rotation_matrices(pose[:, :3]), board_corners) + pose[:, 3:]
        )
        projected = distort(
            in_camera[:, :2] / in_camera[:, 2:], x[4:LENS_PARAMETERS], fisheye=True
        )[0]
        return np.asarray((projected * x[:2] + x[2:4] - corners).ravel())

    scale = np.maximum(np.abs(start), 1e-2)
    solution = least_squares(miss, start, x_scale=scale, max_nfev=20)
    x, residual = solution.x, solution.fun
    if not np.isfinite(x).all():
        raise CaptureError(
            "no fisheye can be computed from the views",
            code="calibration-unsolvable",
            where="calibration",
            action="Take views with more tilt",
        )
    variance = (residual @ residual) / max(len(residual) - len(x), 1)
    covariance = variance * np.linalg.pinv(solution.jac.T @ solution.jac)
    sigma = np.append(np.sqrt(np.maximum(np.diag(covariance)[:LENS_PARAMETERS], 0.0)), 0.0)
    matrix = np.array([[x[0], 0, x[2]], [0, x[1], x[3]], [0, 0, 1.0]])
    error = float(np.sqrt(2 * np.mean(residual * residual)))
    return SolvedLens(matrix, np.array(x[4:LENS_PARAMETERS]), error, sigma)


def find_board_pose(
    camera: Camera, points: Float, corners: Float
) -> tuple[Float, Float, Float] | None:
    """Find the pose of a board in front of a camera.

    Args:
        camera: The camera.
        points: Points of the board (n, 3), mm.
        corners: Their corners in the image (n, 2), px.

    Returns:
        Rotation (3, 3) and translation (3,), mm, from the board to the camera's frame, and the
        projected points (n, 2), px; None if there is no solution.
    """
    plane = camera.to_plane(corners)
    is_known = np.isfinite(plane).all(axis=1)
    if is_known.sum() < 4:
        return None
    is_solved, r, t = cv2.solvePnP(points[is_known], plane[is_known], np.eye(3), None)
    if not is_solved:
        return None
    R, t = cv2.Rodrigues(r)[0], np.asarray(t, float).ravel()
    in_camera = points @ R.T + t
    with np.errstate(divide="ignore", invalid="ignore"):
        projected = camera.to_pixels(
            np.where(in_camera[:, 2:] > 0, in_camera[:, :2] / in_camera[:, 2:], np.nan)
        )
    return np.asarray(R, float), t, projected


MIN_VIEWS = 8
OUTLIER_FACTOR = 3.0  # relative to the median error: worse views are left out
MIN_OUTLIER_PX = 0.15  # a view with a smaller error is never left out
MIN_BOARD_ANGLE_DEG = 5.0  # of the boards from their mean
MIN_TILT_DEG = 12
MAX_FOCAL_SIGMA = 0.02  # relative
MAX_ERROR_PX = 3


@dataclass(frozen=True)
class Intrinsics:
    """Calibration of one camera from n views.

    Attributes:
        camera: The camera at the world's origin.
        error: Root mean square residual, px.
        errors: The same for each view (n,), px.
        used: Whether each view was used (n,).
        sigma: Standard deviations (9,) of fx, fy, cx, cy, px, and k1, k2, p1, p2, k3; for a fisheye
            the last five are those of k1 to k4, and zero.
        tilt: Angle between board and line of sight (n,), degrees.
    """

    camera: Camera
    error: float
    errors: Float
    used: Bool
    sigma: Float
    tilt: Float


def calibrate_camera(
    name: str,
    size: tuple[int, int],
    board: CharucoBoard,
    views: Sequence[BoardView],
    *,
    fisheye: bool = False,
) -> Intrinsics:
    """Calibrate a camera from at least eight views in which the board is tilted.

    Args:
        name: Name of the camera.
        size: Width and height of its images, px.
        board: The board.
        views: Views of the board.
        fisheye: Whether the lens is a fisheye.

    Raises:
        CaptureError: If the views are too few, do not fit, or do not determine the camera.
    """
    if len(views) < MIN_VIEWS:
        raise CaptureError(
            f"the board was found in {len(views)} views, but {MIN_VIEWS} are needed",
            code="too-few-views",
            where=f"camera {name}",
            action="Hold the board still and well lit, at more positions and tilts",
            camera=name,
            count=len(views),
        )
    used = np.ones(len(views), bool)
    fit_views = partial(_fit_lens, size, board, views, fisheye=fisheye)
    fit = fit_views(used)
    for _ in range(3):
        limit = max(OUTLIER_FACTOR * float(np.median(fit.errors[used])), MIN_OUTLIER_PX)
        is_good = fit.errors <= limit
        if (is_good == used).all() or is_good.sum() < MIN_VIEWS:
            break
        used = is_good
        fit = fit_views(used)
    if not np.isfinite(fit.error) or fit.error > MAX_ERROR_PX:
        raise CaptureError(
            f"the views do not fit one camera (reprojection error {fit.error:.1f} px)",
            code="views-inconsistent",
            where=f"camera {name}",
            action=(
                "Check that board.json describes this board, that the board is flat, and that zoom"
                " and focus were not changed"
            ),
            camera=name,
        )
    # Parallel boards do not determine the camera, wherever they are in the image; its parameters
    # would then be wrong by far more than their sigma.
    normals = fit.normals[used]
    mean_normal = normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0))
    angles = np.degrees(np.arccos(np.clip(normals @ mean_normal, -1, 1)))
    if (
        angles.max() < MIN_BOARD_ANGLE_DEG
        or np.max(fit.tilt[used]) < MIN_TILT_DEG
        or fit.sigma[0] > MAX_FOCAL_SIGMA * fit.matrix[0, 0]
    ):
        raise CaptureError(
            "the board always faces the camera, so the focal length is uncertain"
            f" ({fit.matrix[0, 0]:.0f} +- {fit.sigma[0]:.0f} px)",
            code="focal-length-uncertain",
            where=f"camera {name}",
            action="Tilt the board by 30 to 45 degrees, each way",
            camera=name,
        )
    camera = Camera(name, size, fit.matrix, fit.distortions, np.eye(3), np.zeros(3), fisheye)
    return Intrinsics(camera, fit.error, fit.errors, used, fit.sigma, fit.tilt)


@dataclass(frozen=True)
class _Fit:
    matrix: Float
    distortions: Float
    error: float
    errors: Float
    sigma: Float
    tilt: Float
    normals: Float  # (n, 3), of the boards in the camera's frame


def _fit_lens(
    size: tuple[int, int],
    board: CharucoBoard,
    views: Sequence[BoardView],
    used: Bool,
    *,
    fisheye: bool,
) -> _Fit:
    used_views = [v for v, u in zip(views, used, strict=True) if u]
    lens = (solve_fisheye if fisheye else _solve_pinhole)(size, board, used_views)
    camera = Camera("camera", size, lens.matrix, lens.distortions, np.eye(3), np.zeros(3), fisheye)
    errors, tilt, normals = np.empty(len(views)), np.empty(len(views)), np.empty((len(views), 3))
    for k, view in enumerate(views):
        errors[k], tilt[k], normals[k] = _evaluate_view(board, view, camera)
    return _Fit(lens.matrix, lens.distortions, lens.error, errors, lens.sigma, tilt, normals)


def _solve_pinhole(
    size: tuple[int, int], board: CharucoBoard, views: Sequence[BoardView]
) -> SolvedLens:
    board_corners = [board.corners[v.ids].astype(np.float32) for v in views]
    corners = [v.corners.astype(np.float32) for v in views]
    count = sum(2 * len(v.ids) for v in views)
    best, best_score = None, np.inf
    square_pixels = cv2.CALIB_FIX_ASPECT_RATIO
    for flags, parameters in (
        (square_pixels | cv2.CALIB_FIX_K3, 7),
        (square_pixels, 8),
        (cv2.CALIB_FIX_K3, 8),
        (0, 9),
    ):
        try:
            solution = cv2.calibrateCameraExtended(
                board_corners, corners, size, np.eye(3), np.zeros(5), flags=flags
            )
        except cv2.error as problem:
            raise CaptureError(
                f"no calibration can be computed from the views ({problem.err})",
                code="calibration-unsolvable",
                where="calibration",
                action="Take views with more tilt",
            ) from None
        score = count * np.log(solution[0] ** 2 / 2) + np.log(count) * (parameters + 6 * len(views))
        if score < best_score - 1e-9:
            best, best_score = solution, score
    assert best is not None
    error, matrix, distortions, _, _, sigma, *_ = best
    distortions = np.asarray(distortions, float).ravel()[:5]
    sigmas = np.array(sigma, float).ravel()[:9]
    sigmas[0] = sigmas[0] or sigmas[1]  # square pixels have one focal length
    return SolvedLens(np.asarray(matrix, float), distortions, float(error), sigmas)


def _evaluate_view(
    board: CharucoBoard, view: BoardView, camera: Camera
) -> tuple[float, float, Float]:
    """Return a view's root mean square error, px, tilt, degrees, and the board's normal (3,)."""
    pose = find_board_pose(camera, board.corners[view.ids], view.corners)
    if pose is None:
        return float("inf"), 0.0, np.array([0.0, 0.0, 1.0])
    R, t, projected = pose
    normal, line_of_sight = R[:, 2], t / np.linalg.norm(t)
    tilt = np.degrees(np.arccos(np.clip(abs(float(normal @ line_of_sight)), 0, 1)))
    residual = projected - view.corners
    return float(np.sqrt((residual**2).sum(axis=1).mean())), float(tilt), np.asarray(normal, float)
