"""Where tags are, from one camera: by how large they look.

A square of known size is fitted to its four corners, in both of the ways in which a small square
can be tilted (Collins & Bartoli 2014). Depth is weak: it comes with its uncertainty, to which the
other tilt adds what it cannot be told from.
"""

from __future__ import annotations

import cv2
import numpy as np

from ...core.arrays import Bool, Float
from ...core.camera import Camera
from ...core.curves.rotation_vectors import cross_matrices, rotations
from .triangulation import Triangulated

_STEPS = 8
_MISS = 2.0  # px, root mean square: more is no square of this size


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
    R, t, known = _begin(camera, seen, size)
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
    good = np.isfinite(chi[row, first]) & (miss <= _MISS)
    turn = camera.rotation
    at = np.flatnonzero(used)
    out.corners[at[good]] = (best[good] - camera.translation) @ turn
    out.covariance[at[good]] = turn.T @ widened[good] @ turn
    out.miss[at[good]] = miss[good]
    out.used[at[~good]] = False
    return out


def _begin(camera: Camera, seen: Float, size: float) -> tuple[Float, Float, Bool]:
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
        for step in range(_STEPS + 1):
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
            if step == _STEPS:
                break
            g = np.nan_to_num(np.einsum("nkc,nk->nc", WJ, miss.reshape(-1, 8)))
            N = N + 1e-9 * np.eye(6) * np.trace(N, axis1=1, axis2=2)[:, None, None]
            d = np.linalg.solve(N, g[..., None])[..., 0]
            angle = np.linalg.norm(d[:, :3], axis=1, keepdims=True)
            d[:, :3] *= np.minimum(1.0, 0.3 / np.maximum(angle, 1e-12))
            R = rotations(d[:, :3]) @ R
            t = t + d[:, 3:]
    return X, np.linalg.inv(N)[:, 3:, 3:], chi, (miss**2).sum(axis=(1, 2))
