"""Locate tags from the corners that cameras see.

Tags that several cameras see are triangulated. Each corner is found by weighted least squares over
the pixels of all cameras that see it (the gold standard of Hartley & Zisserman 2004, section 12.3,
with covariances in place of equal noise). The position of a tag is the mean of its corners, which
does not depend on its size.

A tag that only one camera sees is located by its apparent size: a square of known size is fitted to
its four corners, in both of the ways in which a small square can be tilted (Collins & Bartoli
2014). Its depth is uncertain, and the covariance includes the other tilt as far as it cannot be
ruled out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.rotations import cross_matrices, rotation_matrices

POSE_STEPS = 8
MAX_POSE_RESIDUAL_PX = 2.0  # root mean square; more is not a square of this size


def tag_corners(size: float) -> Float:
    """Return the corners of a tag (4, 3), mm, in its own frame.

    They are clockwise from its top left; x is to the right, y up, z towards the viewer.
    """
    half = size / 2
    return np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])


def locate_single(camera: Camera, corners: Float, covariance: Float, size: float) -> Triangulated:
    """Locate n tags by one camera.

    A wrong size scales all positions from the camera together.

    Args:
        camera: The camera.
        corners: Corners (n, 4, 2), px without distortion.
        covariance: Covariances (n, 5, 2, 2), px^2, of each corner and last of their mean.
        size: Side of the tags, mm.

    Returns:
        The tags, as by `triangulate` with one camera.
    """
    n = len(corners)
    is_visible = np.asarray(np.isfinite(corners).all(axis=(1, 2)))
    out = Triangulated(
        np.full((n, 4, 3), np.nan),
        np.full((n, 3, 3), np.nan),
        is_visible[:, None].copy(),
        np.full(n, np.nan),
    )
    if not is_visible.any():
        return out
    visible_corners, S = corners[is_visible], covariance[is_visible, :4]
    R, t, is_known = _start_poses(camera, visible_corners, size)
    W = np.asarray(np.linalg.inv(S), float)
    twice = np.repeat(np.arange(len(visible_corners)), 2)
    X, cov, chi, squares = _fit(
        camera, visible_corners[twice], W[twice], R.reshape(-1, 3, 3), t.reshape(-1, 3), size
    )
    X, cov = X.reshape(-1, 2, 4, 3), cov.reshape(-1, 2, 3, 3)
    chi = np.where(is_known & np.isfinite(chi.reshape(-1, 2)), chi.reshape(-1, 2), np.inf)
    squares = squares.reshape(-1, 2)
    first = chi.argmin(axis=1)
    row = np.arange(len(visible_corners))
    best_corners, other_corners = X[row, first], X[row, 1 - first]
    center, other_center = best_corners.mean(axis=1), other_corners.mean(axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        chi_difference = np.maximum(chi[row, 1 - first] - chi[row, first], 0.0)
        share = np.where(
            np.isfinite(chi_difference),
            np.exp(-chi_difference / 2) / (1 + np.exp(-chi_difference / 2)),
            0.0,
        )
    step = np.where(share[:, None] > 0, other_center - center, 0.0)
    widened = cov[row, first] * np.maximum(chi[row, first] / 2, 1.0)[:, None, None]
    widened = widened + share[:, None, None] * step[:, :, None] * step[:, None, :]
    residual = np.sqrt(squares[row, first] / 8)
    is_good = np.isfinite(chi[row, first]) & (residual <= MAX_POSE_RESIDUAL_PX)
    camera_rotation = camera.rotation
    rows = np.flatnonzero(is_visible)
    out.corners[rows[is_good]] = (best_corners[is_good] - camera.translation) @ camera_rotation
    out.covariance[rows[is_good]] = camera_rotation.T @ widened[is_good] @ camera_rotation
    out.miss[rows[is_good]] = residual[is_good]
    out.used[rows[~is_good]] = False
    return out


def _start_poses(camera: Camera, corners: Float, size: float) -> tuple[Float, Float, Bool]:
    """Return rotations (n, 2, 3, 3) and translations (n, 2, 3) of both tilts, and which exist (n,
    2).
    """
    n = len(corners)
    R, t = np.tile(np.eye(3), (n, 2, 1, 1)), np.tile([0.0, 0.0, 1.0], (n, 2, 1))
    is_known = np.zeros((n, 2), bool)
    model = tag_corners(size)
    for k in range(n):
        count, rs, ts, _ = cv2.solvePnPGeneric(
            model, corners[k], camera.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        for i in range(min(int(count), 2)):
            R[k, i], t[k, i] = cv2.Rodrigues(rs[i])[0], ts[i].ravel()
            is_known[k, i] = np.isfinite(R[k, i]).all() and t[k, i, 2] > 0
    return R, t, is_known


def _fit(
    camera: Camera, corners: Float, W: Float, R: Float, t: Float, size: float
) -> tuple[Float, Float, Float, Float]:
    """Fit rotation and translation of squares by the Gauss-Newton method.

    Returns:
        Corners (n, 4, 3), mm, in the camera's frame, covariances of their middle (n, 3, 3), mm^2,
        chi square (n,), and sums of squares (n,), px^2.
    """
    model = tag_corners(size)
    with np.errstate(all="ignore"):
        for step in range(POSE_STEPS + 1):
            rotated = model @ np.swapaxes(R, -1, -2)
            X = rotated + t[:, None]
            plane = X[..., :2] / X[..., 2:]
            residual = corners - plane * camera.focal - camera.matrix[:2, 2]
            D = np.zeros((*plane.shape, 3))
            D[..., 0, 0] = D[..., 1, 1] = 1.0
            D[..., 2] = -plane
            D = D / X[..., 2:, None] * camera.focal[:, None]
            J = np.concatenate([-D @ cross_matrices(rotated), D], axis=-1)
            WJ = (W @ J).reshape(-1, 8, 6)
            N = np.swapaxes(J.reshape(-1, 8, 6), -1, -2) @ WJ
            N = np.where(np.isfinite(N).all(axis=(1, 2), keepdims=True), N, np.eye(6))
            chi = np.einsum("nki,nkij,nkj->n", residual, W, residual)
            if step == POSE_STEPS:
                break
            g = np.nan_to_num(np.einsum("nkc,nk->nc", WJ, residual.reshape(-1, 8)))
            N = N + 1e-9 * np.eye(6) * np.trace(N, axis1=1, axis2=2)[:, None, None]
            d = np.linalg.solve(N, g[..., None])[..., 0]
            angle = np.linalg.norm(d[:, :3], axis=1, keepdims=True)
            d[:, :3] *= np.minimum(1.0, 0.3 / np.maximum(angle, 1e-12))
            R = rotation_matrices(d[:, :3]) @ R
            t = t + d[:, 3:]
    return X, np.linalg.inv(N)[:, 3:, 3:], chi, (residual**2).sum(axis=(1, 2))


TRIANGULATION_STEPS, CONVERGED_MM = 3, 1e-5  # after a smaller step there is no other
MAX_RESIDUAL_PX = 2.0  # root mean square; a tag with more is not the same in all views
COVARIANCE_WEIGHT = 4.0  # degrees of freedom of the stated covariances, relative to the residuals


@dataclass(frozen=True)
class Triangulated:
    """n located tags; NaN where a tag could not be located.

    Attributes:
        corners: Corners (n, 4, 3), mm, in the world.
        covariance: Covariances of their middles (n, 3, 3), mm^2.
        used: Cameras that agree (n, v).
        miss: Root mean square residuals over these cameras (n,), px.
    """

    corners: Float
    covariance: Float
    used: Bool
    miss: Float

    @property
    def points(self) -> Float:
        """Middles of the tags (n, 3), mm."""
        return np.asarray(self.corners.mean(axis=1))


def triangulate(cameras: Sequence[Camera], corners: Float, covariance: Float) -> Triangulated:
    """Locate n tags by at least two of v cameras that agree.

    With three cameras or more, one that disagrees is left out; two that disagree locate nothing.

    Args:
        cameras: The v cameras.
        corners: Corners (n, v, 4, 2), px without distortion, NaN where a camera does not see the
            tag.
        covariance: Covariances (n, v, 5, 2, 2), px^2, of each corner and last of their mean.
    """
    used = np.asarray(np.isfinite(corners).all(axis=(2, 3)))
    out = _solve(cameras, corners, covariance, used)
    is_wrong = out.used.any(axis=1) & ~_agrees(out)
    _assign(out, is_wrong, None)
    for excluded in range(len(cameras)):
        rows = np.flatnonzero(is_wrong & used[:, excluded] & (used.sum(axis=1) > 2))
        kept = used[rows]
        kept[:, excluded] = False
        candidate = _solve(cameras, corners[rows], covariance[rows], kept)
        with np.errstate(invalid="ignore"):
            is_better = _agrees(candidate) & ~(candidate.miss >= out.miss[rows])
        _assign(out, rows[is_better], candidate, is_better)
    return out


def _assign(
    out: Triangulated, rows: Int | Bool, located: Triangulated | None, selected: Bool | None = None
) -> None:
    """Write selected results, or nothing, into `rows`."""
    if located is None:
        out.corners[rows], out.covariance[rows], out.miss[rows] = np.nan, np.nan, np.nan
        out.used[rows] = False
        return
    out.corners[rows], out.covariance[rows] = (
        located.corners[selected],
        located.covariance[selected],
    )
    out.used[rows], out.miss[rows] = located.used[selected], located.miss[selected]


def _agrees(located: Triangulated) -> Bool:
    with np.errstate(invalid="ignore"):
        return np.asarray(located.miss <= MAX_RESIDUAL_PX)


def _solve(
    cameras: Sequence[Camera], corners: Float, covariance: Float, used: Bool
) -> Triangulated:
    n, v = used.shape
    out = Triangulated(
        np.full((n, 4, 3), np.nan), np.full((n, 3, 3), np.nan), used.copy(), np.full(n, np.nan)
    )
    has_enough = used.sum(axis=1) >= 2
    out.used[~has_enough] = False
    if not has_enough.any():
        return out
    is_used = used[has_enough]
    pixels = np.where(is_used[..., None, None], corners[has_enough], 0.0)
    W = np.zeros((len(is_used), v, 5, 2, 2))
    W[is_used] = np.linalg.inv(covariance[has_enough][is_used])
    X = _start_points(cameras, pixels, is_used)
    squares = np.zeros(len(is_used))
    has_converged = False
    for step in range(TRIANGULATION_STEPS + 1):
        N, g = np.zeros((len(is_used), 4, 3, 3)), np.zeros((len(is_used), 4, 3))
        chi, squares = np.zeros(len(is_used)), np.zeros(len(is_used))
        for c, camera in enumerate(cameras):
            residual, J = _residuals(camera, X, pixels[:, c])
            residual = np.where(is_used[:, c, None, None], residual, 0.0)
            JW = J.swapaxes(2, 3) @ W[:, c, :4]
            N += JW @ J
            g += (JW @ residual[..., None])[..., 0]
            chi += (residual * (W[:, c, :4] @ residual[..., None])[..., 0]).sum(axis=(1, 2))
            squares += (residual**2).sum(axis=(1, 2))
        if has_converged or step == TRIANGULATION_STEPS:
            break
        step_size = np.linalg.solve(N, g[..., None])[..., 0]
        X = X + step_size
        has_converged = bool(np.abs(step_size).max() < CONVERGED_MM)
    degrees = 8 * is_used.sum(axis=1) - 12
    center = X.mean(axis=1, keepdims=True)
    N = np.zeros((len(is_used), 3, 3))
    for c, camera in enumerate(cameras):
        J = _residuals(camera, center, center[..., :2])[1][:, 0]
        N += J.swapaxes(1, 2) @ W[:, c, 4] @ J
    cov = np.linalg.inv(N)
    out.corners[has_enough] = X
    out.covariance[has_enough] = (
        cov * ((chi + COVARIANCE_WEIGHT) / (degrees + COVARIANCE_WEIGHT))[:, None, None]
    )
    out.miss[has_enough] = np.sqrt(squares / (8 * is_used.sum(axis=1)))
    ahead = np.ones(len(is_used), bool)
    for c, camera in enumerate(cameras):
        ahead &= ~is_used[:, c] | (camera.to_camera(X)[..., 2] > 0).all(axis=1)
    lost = np.flatnonzero(has_enough)[~ahead | ~np.isfinite(X).all(axis=(1, 2))]
    for k in lost:
        out.miss[k] = np.inf  # behind a camera: these views do not belong together
    return out


def _start_points(cameras: Sequence[Camera], pixels: Float, used: Bool) -> Float:
    """Return the corners (n, 4, 3), mm, nearest to all rays."""
    N, g = np.zeros((len(pixels), 4, 3, 3)), np.zeros((len(pixels), 4, 3))
    for c, camera in enumerate(cameras):
        plane = (pixels[:, c] - camera.matrix[:2, 2]) / camera.focal
        ray = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1) @ camera.rotation
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        P = (np.eye(3) - ray[..., :, None] * ray[..., None, :]) * used[:, c, None, None, None]
        N += P
        g += P @ camera.center
    N += 1e-12 * np.eye(3)
    return np.asarray(np.linalg.solve(N, g[..., None])[..., 0])


def _residuals(camera: Camera, X: Float, pixels: Float) -> tuple[Float, Float]:
    """Return pixels less the projections of corners X (n, 4, 3), (n, 4, 2) px, and the projections'
    derivatives (n, 4, 2, 3).
    """
    points = camera.to_camera(X)
    z = np.where(np.abs(points[..., 2:]) > 1e-9, points[..., 2:], 1e-9)
    plane = points[..., :2] / z
    residual = pixels - (plane * camera.focal + camera.matrix[:2, 2])
    D = np.zeros((*plane.shape, 3))
    D[..., 0, 0] = D[..., 1, 1] = 1.0
    D[..., 2] = -plane
    return residual, (D / z[..., None] * camera.focal[:, None]) @ camera.rotation


CHUNK_TAGS = 20_000  # solved at once, to limit memory


@dataclass(frozen=True)
class Reconstruction:
    """m tags at n instants.

    Attributes:
        points: Positions (n, m, 3), mm, in the world, NaN where not located.
        covariance: Covariances (n, m, 3, 3), mm^2.
        cameras: Number of cameras that agree (n, m).
        miss: Root mean square residuals (n, m), px.
        sides: Mean sides of the tags as located by several cameras (n, m), mm.
        views: Number of cameras that see the tag (n, m).
        corners: Corners as located by several cameras (n, m, 4, 3), mm.
    """

    points: Float
    covariance: Float
    cameras: Int
    miss: Float
    sides: Float
    views: Int
    corners: Float


def reconstruct(
    cameras: Sequence[Camera],
    corners: Float,
    covariance: Float,
    size: float,
) -> Reconstruction:
    """Locate tags by v cameras: by triangulation if two see them, by their size if one does.

    Args:
        cameras: The v cameras.
        corners: Corners (n, m, v, 4, 2), px without distortion.
        covariance: Covariances (n, m, v, 5, 2, 2), px^2, of each corner and last of their mean.
        size: Side of the tags, mm.
    """
    n, m, v = corners.shape[:3]
    flat_corners, flat_covariance = corners.reshape(-1, v, 4, 2), covariance.reshape(-1, v, 5, 2, 2)
    points, cov = np.full((n * m, 3), np.nan), np.full((n * m, 3, 3), np.nan)
    count, miss = np.zeros(n * m, int), np.full(n * m, np.nan)
    sides, outlines = np.full(n * m, np.nan), np.full((n * m, 4, 3), np.nan)
    is_visible = np.asarray(np.isfinite(flat_corners).all(axis=(2, 3)))
    by_several = np.flatnonzero(is_visible.sum(axis=1) >= 2)
    for rows in _divide(by_several):
        located = triangulate(cameras, flat_corners[rows], flat_covariance[rows])
        points[rows], cov[rows], outlines[rows] = (
            located.points,
            located.covariance,
            located.corners,
        )
        count[rows], miss[rows] = located.used.sum(axis=1), located.miss
        edges = located.corners - np.roll(located.corners, 1, axis=1)
        sides[rows] = np.linalg.norm(edges, axis=2).mean(axis=1)
    by_one = is_visible.sum(axis=1) == 1
    for c, camera in enumerate(cameras):
        for rows in _divide(np.flatnonzero(by_one & is_visible[:, c])):
            located = locate_single(camera, flat_corners[rows, c], flat_covariance[rows, c], size)
            points[rows], cov[rows] = located.points, located.covariance
            count[rows], miss[rows] = located.used.sum(axis=1), located.miss
    return Reconstruction(
        points.reshape(n, m, 3),
        cov.reshape(n, m, 3, 3),
        count.reshape(n, m),
        miss.reshape(n, m),
        sides.reshape(n, m),
        is_visible.sum(axis=1).reshape(n, m),
        outlines.reshape(n, m, 4, 3),
    )


def _divide(rows: Int) -> list[Int]:
    return [rows[k : k + CHUNK_TAGS] for k in range(0, len(rows), CHUNK_TAGS)]
