"""A camera's focal lengths, principal point and distortion, from views of a board (Zhang 2000).

Views that fit much worse than the rest (blurred, or a board that was bent) are left out. The third
radial coefficient, and pixels that are not square, are only taken where they are worth it (Bayesian
information criterion).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from scipy.optimize import least_squares

from ...core.arrays import Bool, Float
from ...core.camera import Camera, distort, rotation_matrices
from ...core.errors import CaptureError
from ..tags.detection import BoardView
from ..tags.tag_patterns import CharucoBoard

# A fisheye's focal lengths, principal point and four coefficients, from views of a board.
#
# OpenCV's fit begins; least squares over all parameters, poses of the board among them, end it and
# tell the standard deviations.

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
        at = np.einsum("nij,nj->ni", rotation_matrices(pose[:, :3]), flat) + pose[:, 3:]
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


# A board before one camera.


def board_pose(camera: Camera, points: Float, corners: Float) -> tuple[Float, Float, Float] | None:
    """Rotation (3, 3) and translation (3,) mm from the board to the camera's frame by which its
    `points` (n, 3) mm come nearest to the `corners` (n, 2) px, and where they are shown (n, 2) px;
    None where there is none."""
    plane = camera.to_plane(corners)
    good = np.isfinite(plane).all(axis=1)
    if good.sum() < 4:
        return None
    found, r, t = cv2.solvePnP(points[good], plane[good], np.eye(3), None)
    if not found:
        return None
    R, t = cv2.Rodrigues(r)[0], np.asarray(t, float).ravel()
    at = points @ R.T + t
    with np.errstate(divide="ignore", invalid="ignore"):
        shown = camera.to_pixels(np.where(at[:, 2:] > 0, at[:, :2] / at[:, 2:], np.nan))
    return np.asarray(R, float), t, shown


LEAST_VIEWS = 8
_ODD = 3.0  # medians of the views' errors, above which one is left out
_ABOVE = 0.15  # px, below which none is
_PARALLEL = 5.0  # degrees of all boards from their mean


@dataclass(frozen=True)
class Intrinsics:
    """A `camera` at the world's origin; root mean square `error` px; of each of n views its
    `errors` (n,) px and whether it was `used` (n,); standard deviations `sigma` (9,) of fx, fy, cx,
    cy, px, and k1, k2, p1, p2, k3; `tilt` (n,), degrees between board and line of sight."""

    camera: Camera
    error: float
    errors: Float
    used: Bool
    sigma: Float
    tilt: Float


def calibrate(
    name: str, size: tuple[int, int], board: CharucoBoard, views: Sequence[BoardView],
    *, fisheye: bool = False,
) -> Intrinsics:  # fmt: skip
    """From at least eight views, in which the board is tilted. Of a `fisheye` the last five of the
    standard deviations are those of k1 to k4, and zero. Raises CaptureError where they do not
    tell."""
    if len(views) < LEAST_VIEWS:
        raise CaptureError(
            f"camera {name}: the board was found in {len(views)} views, but {LEAST_VIEWS} are"
            " needed; hold it still and well lit, at more positions and tilts",
            code="views-too-few",
            camera=name,
            count=len(views),
        )
    used = np.ones(len(views), bool)
    solve = partial(_solve, size, board, views, fisheye=fisheye)
    fit = solve(used)
    for _ in range(3):
        limit = max(_ODD * float(np.median(fit.errors[used])), _ABOVE)
        good = fit.errors <= limit
        if (good == used).all() or good.sum() < LEAST_VIEWS:
            break
        used = good
        fit = solve(used)
    if not np.isfinite(fit.error) or fit.error > 3:
        raise CaptureError(
            f"camera {name}: the views do not fit one camera (reprojection error"
            f" {fit.error:.1f} px); check that board.json describes this board, that the"
            " board is flat, and that zoom and focus were not changed",
            code="views-inconsistent",
            camera=name,
        )
    # Boards that are parallel to each other say nothing, wherever they are in the image; what they
    # are solved for is then wrong by far more than its sigma.
    normals = fit.normals[used]
    middle = normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0))
    apart = np.degrees(np.arccos(np.clip(normals @ middle, -1, 1)))
    if (
        apart.max() < _PARALLEL
        or np.max(fit.tilt[used]) < 12
        or fit.sigma[0] > 0.02 * fit.matrix[0, 0]
    ):
        raise CaptureError(
            f"camera {name}: the board always faces the camera, so that the focal length is"
            f" uncertain ({fit.matrix[0, 0]:.0f} +- {fit.sigma[0]:.0f} px); tilt it by 30 to"
            " 45 degrees, each way",
            code="focal-length-uncertain",
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


def _solve(
    size: tuple[int, int], board: CharucoBoard, views: Sequence[BoardView], used: Bool,
    *, fisheye: bool,
) -> _Fit:  # fmt: skip
    chosen = [v for v, u in zip(views, used, strict=True) if u]
    found = (solve_fisheye if fisheye else _pinhole)(size, board, chosen)
    camera = Camera(
        "camera", size, found.matrix, found.distortions, np.eye(3), np.zeros(3), fisheye
    )
    errors, tilt, normals = np.empty(len(views)), np.empty(len(views)), np.empty((len(views), 3))
    for k, view in enumerate(views):
        errors[k], tilt[k], normals[k] = _one(board, view, camera)
    return _Fit(found.matrix, found.distortions, found.error, errors, found.sigma, tilt, normals)


def _pinhole(size: tuple[int, int], board: CharucoBoard, chosen: Sequence[BoardView]) -> SolvedLens:
    flat = [board.corners[v.ids].astype(np.float32) for v in chosen]
    seen = [v.corners.astype(np.float32) for v in chosen]
    count = sum(2 * len(v.ids) for v in chosen)
    best, least = None, np.inf
    square = cv2.CALIB_FIX_ASPECT_RATIO
    for flags, free in (
        (square | cv2.CALIB_FIX_K3, 7), (square, 8), (cv2.CALIB_FIX_K3, 8), (0, 9)
    ):  # fmt: skip
        try:
            found = cv2.calibrateCameraExtended(
                flat, seen, size, np.eye(3), np.zeros(5), flags=flags
            )
        except cv2.error as problem:
            raise CaptureError(
                f"no calibration can be computed from the views ({problem.err}); take"
                " others with more tilt",
                code="calibration-unsolvable",
            ) from None
        score = count * np.log(found[0] ** 2 / 2) + np.log(count) * (free + 6 * len(chosen))
        if score < least - 1e-9:
            best, least = found, score
    assert best is not None
    error, matrix, distortions, _, _, sigma, *_ = best
    distortions = np.asarray(distortions, float).ravel()[:5]
    spread = np.array(sigma, float).ravel()[:9]
    spread[0] = spread[0] or spread[1]  # square pixels: one focal length is the other's
    return SolvedLens(np.asarray(matrix, float), distortions, float(error), spread)


def _one(board: CharucoBoard, view: BoardView, camera: Camera) -> tuple[float, float, Float]:
    """A view's root mean square error, px, tilt, degrees, and the board's normal (3,)."""
    found = board_pose(camera, board.corners[view.ids], view.corners)
    if found is None:
        return float("inf"), 0.0, np.array([0.0, 0.0, 1.0])
    R, t, shown = found
    normal, sight = R[:, 2], t / np.linalg.norm(t)
    tilt = np.degrees(np.arccos(np.clip(abs(float(normal @ sight)), 0, 1)))
    miss = shown - view.corners
    return float(np.sqrt((miss**2).sum(axis=1).mean())), float(tilt), np.asarray(normal, float)
