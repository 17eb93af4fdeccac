"""Where tags are, from the corners that several cameras see.

Each corner of a tag is found by weighted least squares over the pixels of all cameras that see it
(the gold standard of Hartley & Zisserman 2004, 12.3, with covariances in place of equal noise). The
place of a tag is the mean of its corners, which does not depend on its size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera

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
