"""From what each camera saw to where the tags were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera, cross_matrices, rotation_matrices

# Where tags are, from one camera: by how large they look.
#
# A square of known size is fitted to its four corners, in both of the ways in which a small square
# can be tilted (Collins & Bartoli 2014). Depth is weak: it comes with its uncertainty, to which the
# other tilt adds what it cannot be told from.

_STEPS_SINGLE_CAMERA = 8
_MISS_SINGLE_CAMERA = 2.0  # px, root mean square: more is no square of this size


def square(size: float) -> Float:
    """Corners (4, 3) mm of a tag in its own frame, from its top left clockwise: x to the right, y
    up, z towards the viewer."""
    half = size / 2
    return np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])


def locate_single(
    camera: Camera, corners: Float, covariance: Float, size: float, size_sigma: float = 0.0
) -> Triangulated:
    """Tags of `size` mm by one camera: as `locate` with v = 1.

    `corners` (n, 4, 2) px without distortion, `covariance` (n, 5, 2, 2) px^2 of each, and of their
    mean. A wrong size
    scales all places from the camera together; its relative standard deviation `size_sigma` (0.002
    is what a caliper on paper allows) is added along the line of sight.
    """
    n = len(corners)
    used = np.asarray(np.isfinite(corners).all(axis=(1, 2)))
    out = Triangulated(
        np.full((n, 4, 3), np.nan), np.full((n, 3, 3), np.nan), used[:, None].copy(),
        np.full(n, np.nan),
    )  # fmt: skip
    if not used.any():
        return out
    seen, S = corners[used], covariance[used, :4]
    R, t, known = _single_camera_begin(camera, seen, size)
    W = np.asarray(np.linalg.inv(S), float)
    twice = np.repeat(np.arange(len(seen)), 2)
    X, cov, chi, square_ = _fit(
        camera, seen[twice], W[twice], R.reshape(-1, 3, 3), t.reshape(-1, 3), size
    )
    X, cov = X.reshape(-1, 2, 4, 3), cov.reshape(-1, 2, 3, 3)
    chi = np.where(known & np.isfinite(chi.reshape(-1, 2)), chi.reshape(-1, 2), np.inf)
    square_ = square_.reshape(-1, 2)
    first = chi.argmin(axis=1)
    row = np.arange(len(seen))
    best, other = X[row, first], X[row, 1 - first]
    middle, aside = best.mean(axis=1), other.mean(axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        worse = np.maximum(chi[row, 1 - first] - chi[row, first], 0.0)
        share = np.where(np.isfinite(worse), np.exp(-worse / 2) / (1 + np.exp(-worse / 2)), 0.0)
    step = np.where(share[:, None] > 0, aside - middle, 0.0)
    widened = cov[row, first] * np.maximum(chi[row, first] / 2, 1.0)[:, None, None]
    widened = widened + share[:, None, None] * step[:, :, None] * step[:, None, :]
    widened = widened + size_sigma**2 * middle[:, :, None] * middle[:, None, :]
    miss = np.sqrt(square_[row, first] / 8)
    good = np.isfinite(chi[row, first]) & (miss <= _MISS_SINGLE_CAMERA)
    turn = camera.rotation
    at = np.flatnonzero(used)
    out.corners[at[good]] = (best[good] - camera.translation) @ turn
    out.covariance[at[good]] = turn.T @ widened[good] @ turn
    out.miss[at[good]] = miss[good]
    out.used[at[~good]] = False
    return out


def _single_camera_begin(camera: Camera, seen: Float, size: float) -> tuple[Float, Float, Bool]:
    """Rotations (n, 2, 3, 3) and translations (n, 2, 3) of both tilts; which there are (n, 2)."""
    n = len(seen)
    R, t = np.tile(np.eye(3), (n, 2, 1, 1)), np.tile([0.0, 0.0, 1.0], (n, 2, 1))
    known = np.zeros((n, 2), bool)
    model = square(size)
    for k in range(n):
        found, rs, ts, _ = cv2.solvePnPGeneric(
            model, seen[k], camera.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        for i in range(min(int(found), 2)):
            R[k, i], t[k, i] = cv2.Rodrigues(rs[i])[0], ts[i].ravel()
            known[k, i] = np.isfinite(R[k, i]).all() and t[k, i, 2] > 0
    return R, t, known


def _fit(
    camera: Camera, seen: Float, W: Float, R: Float, t: Float, size: float
) -> tuple[Float, Float, Float, Float]:
    """Corners (n, 4, 3) mm in the camera's frame, covariance (n, 3, 3) mm^2 of their middle, chi
    square (n,) and sum of squares (n,) px^2, by Gauss-Newton over rotation and translation."""
    model = square(size)
    with np.errstate(all="ignore"):
        for step in range(_STEPS_SINGLE_CAMERA + 1):
            turned = model @ np.swapaxes(R, -1, -2)
            X = turned + t[:, None]
            plane = X[..., :2] / X[..., 2:]
            miss = seen - plane * camera.focal - camera.matrix[:2, 2]
            D = np.zeros((*plane.shape, 3))
            D[..., 0, 0] = D[..., 1, 1] = 1.0
            D[..., 2] = -plane
            D = D / X[..., 2:, None] * camera.focal[:, None]
            J = np.concatenate([-D @ cross_matrices(turned), D], axis=-1)
            WJ = (W @ J).reshape(-1, 8, 6)
            N = np.swapaxes(J.reshape(-1, 8, 6), -1, -2) @ WJ
            N = np.where(np.isfinite(N).all(axis=(1, 2), keepdims=True), N, np.eye(6))
            chi = np.einsum("nki,nkij,nkj->n", miss, W, miss)
            if step == _STEPS_SINGLE_CAMERA:
                break
            g = np.nan_to_num(np.einsum("nkc,nk->nc", WJ, miss.reshape(-1, 8)))
            N = N + 1e-9 * np.eye(6) * np.trace(N, axis1=1, axis2=2)[:, None, None]
            d = np.linalg.solve(N, g[..., None])[..., 0]
            angle = np.linalg.norm(d[:, :3], axis=1, keepdims=True)
            d[:, :3] *= np.minimum(1.0, 0.3 / np.maximum(angle, 1e-12))
            R = rotation_matrices(d[:, :3]) @ R
            t = t + d[:, 3:]
    return X, np.linalg.inv(N)[:, 3:, 3:], chi, (miss**2).sum(axis=(1, 2))


# Where tags are, from the corners that several cameras see.
#
# Each corner of a tag is found by weighted least squares over the pixels of all cameras that see it
# (the gold standard of Hartley & Zisserman 2004, 12.3, with covariances in place of equal noise). The
# place of a tag is the mean of its corners, which does not depend on its size.

_STEPS, _ENOUGH = 3, 1e-5  # at most; mm, a step after which there is no other
#: px, root mean square: a tag whose corners miss by more is not the same in all views.
_MISS = 2.0
_TRUST = 4.0  # degrees of freedom that the stated covariances count against those of the residuals


@dataclass(frozen=True)
class Triangulated:
    """n tags: `corners` (n, 4, 3) mm in the world, `covariance` (n, 3, 3) mm^2 of their middle,
    `used` (n, v) the cameras that agree, `miss` (n,) px, root mean square over those; NaN where a
    tag could not be located."""

    corners: Float
    covariance: Float
    used: Bool
    miss: Float

    @property
    def points(self) -> Float:
        """Middles (n, 3) mm."""
        return np.asarray(self.corners.mean(axis=1))


def triangulate(cameras: Sequence[Camera], corners: Float, covariance: Float) -> Triangulated:
    """Tags by at least two of v cameras that agree.

    `corners` (n, v, 4, 2) px without distortion, NaN where a camera does not see the tag;
    `covariance` (n, v, 5, 2, 2) px^2 of each corner and of the mean of the four. With three cameras
    or more, one that disagrees is left out; two that disagree locate nothing.
    """
    used = np.asarray(np.isfinite(corners).all(axis=(2, 3)))
    out = _solve(cameras, corners, covariance, used)
    wrong = out.used.any(axis=1) & ~_agrees(out)
    _put(out, wrong, None)
    for leave in range(len(cameras)):
        rows = np.flatnonzero(wrong & used[:, leave] & (used.sum(axis=1) > 2))
        keep = used[rows]
        keep[:, leave] = False
        tried = _solve(cameras, corners[rows], covariance[rows], keep)
        with np.errstate(invalid="ignore"):
            better = _agrees(tried) & ~(tried.miss >= out.miss[rows])
        _put(out, rows[better], tried, better)
    return out


def _put(
    out: Triangulated, rows: Int | Bool, one: Triangulated | None, which: Bool | None = None
) -> None:
    """Into `rows` what was found of `which`, or nothing."""
    if one is None:
        out.corners[rows], out.covariance[rows], out.miss[rows] = np.nan, np.nan, np.nan
        out.used[rows] = False
        return
    out.corners[rows], out.covariance[rows] = one.corners[which], one.covariance[which]
    out.used[rows], out.miss[rows] = one.used[which], one.miss[which]


def _agrees(found: Triangulated) -> Bool:
    with np.errstate(invalid="ignore"):
        return np.asarray(found.miss <= _MISS)


def _solve(
    cameras: Sequence[Camera], corners: Float, covariance: Float, used: Bool
) -> Triangulated:
    n, v = used.shape
    out = Triangulated(
        np.full((n, 4, 3), np.nan), np.full((n, 3, 3), np.nan), used.copy(), np.full(n, np.nan)
    )
    enough = used.sum(axis=1) >= 2
    out.used[~enough] = False
    if not enough.any():
        return out
    use = used[enough]
    seen = np.where(use[..., None, None], corners[enough], 0.0)
    W = np.zeros((len(use), v, 5, 2, 2))
    W[use] = np.linalg.inv(covariance[enough][use])
    X = _begin(cameras, seen, use)
    square = np.zeros(len(use))
    last = False
    for step in range(_STEPS + 1):
        N, g = np.zeros((len(use), 4, 3, 3)), np.zeros((len(use), 4, 3))
        chi, square = np.zeros(len(use)), np.zeros(len(use))
        for c, camera in enumerate(cameras):
            miss, J = _miss(camera, X, seen[:, c])
            miss = np.where(use[:, c, None, None], miss, 0.0)
            JW = J.swapaxes(2, 3) @ W[:, c, :4]
            N += JW @ J
            g += (JW @ miss[..., None])[..., 0]
            chi += (miss * (W[:, c, :4] @ miss[..., None])[..., 0]).sum(axis=(1, 2))
            square += (miss**2).sum(axis=(1, 2))
        if last or step == _STEPS:
            break
        move = np.linalg.solve(N, g[..., None])[..., 0]
        X = X + move
        last = bool(np.abs(move).max() < _ENOUGH)
    free = 8 * use.sum(axis=1) - 12
    middle = X.mean(axis=1, keepdims=True)
    N = np.zeros((len(use), 3, 3))
    for c, camera in enumerate(cameras):
        J = _miss(camera, middle, middle[..., :2])[1][:, 0]
        N += J.swapaxes(1, 2) @ W[:, c, 4] @ J
    cov = np.linalg.inv(N)
    out.corners[enough] = X
    out.covariance[enough] = cov * ((chi + _TRUST) / (free + _TRUST))[:, None, None]
    out.miss[enough] = np.sqrt(square / (8 * use.sum(axis=1)))
    ahead = np.ones(len(use), bool)
    for c, camera in enumerate(cameras):
        ahead &= ~use[:, c] | (camera.to_camera(X)[..., 2] > 0).all(axis=1)
    lost = np.flatnonzero(enough)[~ahead | ~np.isfinite(X).all(axis=(1, 2))]
    for k in lost:
        out.miss[k] = np.inf  # behind a camera: these views do not belong together
    return out


def _begin(cameras: Sequence[Camera], seen: Float, use: Bool) -> Float:
    """Corners (n, 4, 3) nearest to all rays."""
    N, g = np.zeros((len(seen), 4, 3, 3)), np.zeros((len(seen), 4, 3))
    for c, camera in enumerate(cameras):
        plane = (seen[:, c] - camera.matrix[:2, 2]) / camera.focal
        ray = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1) @ camera.rotation
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        P = (np.eye(3) - ray[..., :, None] * ray[..., None, :]) * use[:, c, None, None, None]
        N += P
        g += P @ camera.center
    N += 1e-12 * np.eye(3)
    return np.asarray(np.linalg.solve(N, g[..., None])[..., 0])


def _miss(camera: Camera, X: Float, seen: Float) -> tuple[Float, Float]:
    """seen - projected (n, 4, 2) px of corners X (n, 4, 3), and derivatives (n, 4, 2, 3) of the
    projected."""
    at = camera.to_camera(X)
    z = np.where(np.abs(at[..., 2:]) > 1e-9, at[..., 2:], 1e-9)
    plane = at[..., :2] / z
    miss = seen - (plane * camera.focal + camera.matrix[:2, 2])
    D = np.zeros((*plane.shape, 3))
    D[..., 0, 0] = D[..., 1, 1] = 1.0
    D[..., 2] = -plane
    return miss, (D / z[..., None] * camera.focal[:, None]) @ camera.rotation


_CHUNK = 20_000  # tags solved at once: what the matrices may take of memory


@dataclass(frozen=True)
class Reconstruction:
    """n instants, m tags: `points` (n, m, 3) mm in the world, NaN where not located; `covariance`
    (n, m, 3, 3) mm^2; `cameras` (n, m), how many of them agree; `miss` (n, m) px, their residuals,
    root mean square; `sides` (n, m) mm, the mean side of the tag as located by several cameras;
    `seen` (n, m), cameras that saw the tag; `corners` (n, m, 4, 3) mm as located by several."""

    points: Float
    covariance: Float
    cameras: Int
    miss: Float
    sides: Float
    seen: Int
    corners: Float


def reconstruct(
    cameras: Sequence[Camera],
    corners: Float,
    covariance: Float,
    size: float,
    size_sigma: float = 0.0,
) -> Reconstruction:
    """Tags of `size` mm by v cameras: those that two see by triangulation, those that one sees by
    their size, with `size_sigma` as in `locate_single`. `corners` (n, m, v, 4, 2) px without
    distortion, `covariance` (n, m, v, 5, 2, 2) of each, and of their mean."""
    n, m, v = corners.shape[:3]
    flat, spread = corners.reshape(-1, v, 4, 2), covariance.reshape(-1, v, 5, 2, 2)
    points, cov = np.full((n * m, 3), np.nan), np.full((n * m, 3, 3), np.nan)
    count, miss = np.zeros(n * m, int), np.full(n * m, np.nan)
    sides, outline = np.full(n * m, np.nan), np.full((n * m, 4, 3), np.nan)
    there = np.asarray(np.isfinite(flat).all(axis=(2, 3)))
    many = np.flatnonzero(there.sum(axis=1) >= 2)
    for rows in _chunks(many):
        found = triangulate(cameras, flat[rows], spread[rows])
        points[rows], cov[rows], outline[rows] = found.points, found.covariance, found.corners
        count[rows], miss[rows] = found.used.sum(axis=1), found.miss
        edges = found.corners - np.roll(found.corners, 1, axis=1)
        sides[rows] = np.linalg.norm(edges, axis=2).mean(axis=1)
    one = there.sum(axis=1) == 1
    for c, camera in enumerate(cameras):
        for rows in _chunks(np.flatnonzero(one & there[:, c])):
            found = locate_single(camera, flat[rows, c], spread[rows, c], size, size_sigma)
            points[rows], cov[rows] = found.points, found.covariance
            count[rows], miss[rows] = found.used.sum(axis=1), found.miss
    return Reconstruction(
        points.reshape(n, m, 3), cov.reshape(n, m, 3, 3), count.reshape(n, m), miss.reshape(n, m),
        sides.reshape(n, m), there.sum(axis=1).reshape(n, m), outline.reshape(n, m, 4, 3),
    )  # fmt: skip


def _chunks(rows: Int) -> list[Int]:
    return [rows[k : k + _CHUNK] for k in range(0, len(rows), _CHUNK)]
