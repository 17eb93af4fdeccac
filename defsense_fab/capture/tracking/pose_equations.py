"""What views of tags tell of the poses of their cameras, in any span of frames.

Places of tags are eliminated from the normal equations of a camera's pose (Schur complement; Triggs
et al. 2000, 6), frame by frame; sums over the first so many frames give those of any span.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera, cross_matrices, rotation_matrices
from .reconstruction import square

_STEPS = 6  # of Gauss and Newton for the tags' poses
_FLOOR = 0.05  # px, standard deviation of a corner at least
#: rad and mm, standard deviations of a pose's change.
PRIOR = np.array([0.05] * 3 + [20.0] * 3)
_PIECES = 30  # of all frames, that tell how far poses scatter
_ODD = 3.0  # times as far as the other tags of a frame: tags that count less
_TAGS = 3000  # that are in memory at once


@dataclass(frozen=True)
class SharedViews:
    """n tags of `size` mm that two of v cameras see in some frames: the frame of each (n,), of
    which there are `count`; corners (n, v, 4, 2) px without distortion, NaN where not seen, and the
    variance (n, v) px^2 of their coordinates."""

    size: float
    frame: Int
    count: int
    corners: Float
    variance: Float

    @property
    def seen(self) -> Bool:
        """Which cameras see a tag (n, v)."""
        return np.asarray(np.isfinite(self.corners).all(axis=(2, 3)))


def shared_views(frames: Int, corners: Float, covariance: Float, size: float) -> SharedViews:
    """Of corners (k, m, v, 4, 2) px and covariances (k, m, v, 5, 2, 2) px^2 of k frames."""
    there = np.isfinite(corners).all(axis=(3, 4))
    rows = np.argwhere(there.sum(axis=2) >= 2)
    at = rows[:, 0], rows[:, 1]
    variance = np.trace(covariance[at][:, :, :4], axis1=3, axis2=4).mean(axis=2) / 2
    return SharedViews(size, rows[:, 0], len(frames), corners[at], variance)


@dataclass(frozen=True)
class PoseEquations:
    """Of the first so many frames (k + 1, ...) the normal equations of each camera's pose: N
    (k + 1, v, 6, 6) and g (k + 1, v, 6); how far (v,) the picture moves by them, as the mean of
    squares (k + 1, v, 6, 6) with its count (k + 1, v); and the variance over that stated."""

    N: Float
    g: Float
    picture: Float
    tags: Float
    inflation: float

    def pose(self, c: int, lo: int, hi: int) -> tuple[Float, Float]:
        """Change of a camera's pose (6,) by frames [lo, hi), and the inverse (6, 6) of its normal
        equations."""
        inverse = np.linalg.inv(self.N[hi, c] - self.N[lo, c] + np.diag(1 / PRIOR**2))
        return inverse @ (self.g[hi, c] - self.g[lo, c]), inverse

    def scatter(self, c: int, ends: Sequence[int]) -> Float:
        """Mean square (6, 6) over frames by which pieces of the spans between `ends` differ from
        their spans' poses."""
        total, pieces = np.zeros((6, 6)), 0
        long = max((ends[-1] - ends[0]) / _PIECES, 1.0)
        for lo, hi in pairwise(ends):
            edges = np.linspace(lo, hi, int(np.ceil((hi - lo) / long)) + 1).astype(int)
            N, g = np.diff(self.N[edges, c], axis=0), np.diff(self.g[edges, c], axis=0)
            left = g - N @ self.pose(c, lo, hi)[0]
            total += left.T @ left
            pieces += len(left)
        spans = len(ends) - 1
        return total * pieces / max(pieces - spans, 1) / (ends[-1] - ends[0])


def pose_equations(
    cameras: Sequence[Camera], views: SharedViews, R: Float, T: Float
) -> PoseEquations:
    """For cameras that stand at R (k, v, 3, 3) and T (k, v, 3) in each frame."""
    v = len(cameras)
    N, g = np.zeros((views.count + 1, v, 6, 6)), np.zeros((views.count + 1, v, 6))
    picture, tags = np.zeros((views.count + 1, v, 6, 6)), np.zeros((views.count + 1, v))
    every = []
    for part in _parts(views):
        chi, *each = _of_tags(cameras, part, R, T)
        every.append(chi)
        for total, values in zip((N, g, picture, tags), each, strict=True):
            np.add.at(total, part.frame + 1, values)
    chi = np.concatenate(every) if every else np.zeros(0)
    inflation = max(float(np.median(chi)), 1.0) if len(chi) else 1.0
    N, g, picture, tags = (np.cumsum(x, axis=0) for x in (N, g, picture, tags))
    return PoseEquations(N, g, picture, tags, inflation)


def _parts(views: SharedViews) -> Iterator[SharedViews]:
    """Some frames at a time, for the matrices of all take much memory."""
    starts = np.searchsorted(views.frame, np.arange(views.count + 1))
    at = 0
    while at < views.count:
        to = int(np.searchsorted(starts, starts[at] + _TAGS, side="right")) - 1
        to = min(max(to, at + 1), views.count)
        rows = slice(int(starts[at]), int(starts[to]))
        if rows.stop > rows.start:
            yield replace(
                views,
                frame=views.frame[rows],
                corners=views.corners[rows],
                variance=views.variance[rows],
            )
        at = to


def _of_tags(
    cameras: Sequence[Camera], views: SharedViews, R: Float, T: Float
) -> tuple[Float, Float, Float, Float, Float]:
    """Of each tag: chi square over its degrees of freedom (n,); N (n, v, 6, 6) and g (n, v, 6) of
    the cameras' poses without its own; how far they move the picture, the sum of squares
    (n, v, 6, 6); and which cameras see it (n, v)."""
    use, (n, v) = views.seen, views.seen.shape
    focal = np.stack([c.focal for c in cameras])[:, None]
    middle = np.stack([c.matrix[:2, 2] for c in cameras])[:, None]
    px = np.where(use[..., None, None], views.corners, 0.0)
    w = np.where(use, 1 / np.maximum(views.variance, _FLOOR**2), 0.0)
    R, T = R[views.frame], T[views.frame]
    model = square(views.size)
    turn, place = _poses(R, T, (px - middle) / focal, use, model)
    for step in range(_STEPS + 1):
        turned = model @ np.swapaxes(turn, 1, 2)  # (n, 4, 3)
        X = np.einsum("nvij,nkj->nvki", R, turned + place[:, None]) + T[:, :, None]
        z = np.maximum(X[..., 2:], 1.0)
        plane = X[..., :2] / z
        miss = np.where(use[..., None, None], px - plane * focal - middle, 0.0)
        D = np.zeros((*plane.shape, 3))
        D[..., 0, 0] = D[..., 1, 1] = 1.0
        D[..., 2] = -plane
        D *= (focal / z)[..., None] * use[..., None, None, None]
        DR = D @ R[:, :, None]
        own = np.concatenate([-DR @ cross_matrices(turned)[:, None], DR], axis=-1)
        own = own.reshape(n, v, 8, 6)
        wj = w[..., None, None] * own
        A = np.einsum("nvka,nvkb->nab", wj, own) + 1e-9 * np.eye(6)
        a = np.einsum("nvka,nvk->na", wj, miss.reshape(n, v, 8))
        if step == _STEPS:
            break
        d = np.linalg.solve(A, a[..., None])[..., 0]
        size = np.linalg.norm(d[:, :3], axis=1, keepdims=True)
        d[:, :3] *= np.minimum(1.0, 0.3 / np.maximum(size, 1e-12))
        turn, place = rotation_matrices(d[:, :3]) @ turn, place + d[:, 3:]
    chi = (w * (miss**2).sum(axis=(2, 3))).sum(axis=1) / (8 * use.sum(axis=1) - 6)
    trust = _trust(chi, views)[:, None]
    by = np.concatenate([-D @ cross_matrices(X), D], axis=-1).reshape(n, v, 8, 6)
    wb = (trust * w)[..., None, None] * by
    across = np.einsum("nvka,nvkb->nvab", wb, own)  # camera by tag
    solved = np.linalg.solve(A[:, None], np.swapaxes(across, 2, 3))
    solved = solved / np.maximum(trust, 1e-12)[..., None, None]
    N = np.einsum("nvka,nvkb->nvab", wb, by) - across @ solved
    g = np.einsum("nvka,nvk->nva", wb, miss.reshape(n, v, 8))
    g -= (across @ np.linalg.solve(A, a[..., None])[:, None])[..., 0]
    picture = np.einsum("nvka,nvkb->nvab", by, by) / 4
    return chi, N, g, picture, use.astype(float)


def _trust(chi: Float, views: SharedViews) -> Float:
    """Weights (n,) of tags by how much worse they fit than the others of their frame do."""
    order = np.lexsort((chi, views.frame))
    starts = np.searchsorted(views.frame[order], np.arange(views.count + 1))
    middle = (starts[:-1] + starts[1:]) // 2
    usual = np.full(views.count, 1.0)
    there = starts[1:] > starts[:-1]
    usual[there] = np.maximum(chi[order][middle[there]], 1.0)
    return np.asarray(1 / (1 + (chi / (_ODD**2 * usual[views.frame])) ** 2))


def _poses(R: Float, T: Float, plane: Float, use: Bool, model: Float) -> tuple[Float, Float]:
    """Rotations (n, 3, 3) and places (n, 3) of squares whose corners are nearest to all rays
    through `plane` (n, v, 4, 2)."""
    ray = np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1) @ R
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    center = -np.einsum("nvji,nvj->nvi", R, T)
    P = (np.eye(3) - ray[..., :, None] * ray[..., None, :]) * use[..., None, None, None]
    g = np.einsum("nvkij,nvj->nki", P, center)
    X = np.linalg.solve(P.sum(axis=1) + 1e-12 * np.eye(3), g[..., None])[..., 0]
    middle = X.mean(axis=1)
    u, _, vt = np.linalg.svd(np.swapaxes(X - middle[:, None], 1, 2) @ model)
    sign = np.ones((len(X), 3))
    sign[:, 2] = np.linalg.det(u) * np.linalg.det(vt)
    return (u * sign[:, None]) @ vt, middle
