"""When a camera was moved while it recorded, and by how much, from the tags alone.

A tag is a square of known size: views of it tell how the cameras stand to each other, in depth too,
where their rays would still meet. Places of tags are eliminated from the normal equations of a
camera's pose (Schur complement; Triggs et al. 2000, 6), frame by frame, so that sums over any span
of frames tell that span's pose. A move is where two spans differ by far more than pieces of them do
among themselves: errors of the lens model change with the tags' places, too, but not for good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.rotation_vectors import cross_matrices, rotations
from .single_camera import square

_MOVES = 6  # that are looked for, at most
_STEPS = 6  # of Gauss and Newton for the tags' poses
_FLOOR = 0.05  # px, standard deviation of a corner at least
_PRIOR = np.array([0.05] * 3 + [20.0] * 3)  # rad and mm, standard deviations of a pose's change
_SHORTEST = 12  # frames of a span, but for those in which a camera is moved
_PIECES = 30  # of all frames, that tell how far poses scatter
_CLEAR = 60.0  # chi square of a change that is no chance
_LEAST = 0.4  # px, by which it moves the picture
_ODD = 3.0  # times as far as the other tags of a frame: tags that count less
_BESIDE = 0.2  # s, of which the pictures beside a move are continued
_TELLS = 1.5  # times as far as pictures jump by at other times, that is clear
_TIMES = 60  # others
_ROUNDS = 2  # in which all moves are measured together


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


@dataclass(frozen=True)
class CameraMotion:
    """From frame `at` of the views on, what was at X in the frame of the camera of index `camera`
    is at `rotation` X + `translation` (mm)."""

    camera: int
    at: int
    rotation: Float
    translation: Float

    @property
    def degrees(self) -> float:
        """By how much it was turned."""
        cosine = (np.trace(self.rotation) - 1) / 2
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))

    @property
    def shift(self) -> float:
        """By how much its centre of projection was moved, mm."""
        return float(np.linalg.norm(self.translation))

    def of_other(self, camera: Camera, other: Camera, index: int) -> CameraMotion:
        """The motion of the `other` camera, of this `index`, after which the two stand to each
        other as after this one of `camera`, both as they stood before."""
        turn = camera.rotation @ other.rotation.T  # from the other's frame to this one's
        shift = camera.translation - turn @ other.translation
        R = turn.T @ self.rotation.T @ turn
        t = turn.T @ (self.rotation.T @ (shift - self.translation) - shift)
        return CameraMotion(index, self.at, _orthogonal(R), t)

    def moved(self, camera: Camera) -> Camera:
        """The camera as it stands from then on."""
        return replace(
            camera,
            rotation=_orthogonal(self.rotation @ camera.rotation),
            translation=self.rotation @ camera.translation + self.translation,
        )


def shared_views(frames: Int, corners: Float, covariance: Float, size: float) -> SharedViews:
    """Of corners (k, m, v, 4, 2) px and covariances (k, m, v, 5, 2, 2) px^2 of k frames."""
    there = np.isfinite(corners).all(axis=(3, 4))
    rows = np.argwhere(there.sum(axis=2) >= 2)
    at = rows[:, 0], rows[:, 1]
    variance = np.trace(covariance[at][:, :, :4], axis1=3, axis2=4).mean(axis=2) / 2
    return SharedViews(size, rows[:, 0], len(frames), corners[at], variance)


def find_camera_motion(
    cameras: Sequence[Camera], views: SharedViews, takes: int
) -> list[CameraMotion]:
    """Moves of single cameras, in the order of time, each of which takes so many frames at most to
    either side. Of two cameras only the pose to each other is known: then all moves are the second
    one's, as far as `which_moved` does not tell better."""
    cameras = _as_begun(cameras, views)
    R, T = _start(cameras, views.count)
    found: list[CameraMotion] = []
    movers = range(1, 2) if len(cameras) == 2 else range(len(cameras))
    while len(found) < _MOVES:
        sums = _normal_equations(cameras, _still(views, found, takes), R, T)
        ends = [0, *sorted(m.at for m in found), views.count]
        best: tuple[float, int, int, Float] | None = None
        for c in movers:
            for span in range(len(ends) - 1):
                one = _change(sums, c, ends, span, takes)
                if one is not None and (best is None or one[0] > best[0]):
                    best = (one[0], c, *one[1:])
        if best is None:
            break
        _, c, at, d = best
        motion = CameraMotion(c, at, rotations(d[:3]), d[3:])
        found = sorted([*found, motion], key=lambda m: m.at)
        R, T = _replayed(cameras, views.count, found)
    for _ in range(_ROUNDS if found else 0):
        for k, m in enumerate(found):
            sums = _normal_equations(cameras, _still(views, found, takes), R, T)
            lo = found[k - 1].at if k else 0
            hi = found[k + 1].at if k + 1 < len(found) else views.count
            d = sums.pose(m.camera, m.at, hi)[0] - sums.pose(m.camera, lo, m.at)[0]
            turn = rotations(d[:3])
            found[k] = replace(
                m, rotation=_orthogonal(turn @ m.rotation), translation=turn @ m.translation + d[3:]
            )
            R, T = _replayed(cameras, views.count, found)
    return found


def which_moved(pictures: Sequence[tuple[Float, Float]], at: float, gap: float) -> int | None:
    """Of two cameras, each with times (t,) s and middles of tags (t, m, 2) px, the one whose
    picture jumped at the time `at` +- `gap`, by more than it does while things are moved; None
    where that is not clear."""
    clear, usual = [], []
    for time, px in pictures:
        apart = 2 * (gap + _BESIDE)
        others = np.linspace(time[0] + apart / 2, time[-1] - apart / 2, _TIMES)
        jumps = [_jump(time, px, t, gap) for t in others if abs(t - at) > apart]
        jumps = [j for j in jumps if np.isfinite(j)]
        here = _jump(time, px, at, gap)
        if len(jumps) < _TIMES // 4 or not np.isfinite(here):
            return None
        clear.append(here > _TELLS * np.quantile(jumps, 0.95))
        usual.append(here < np.quantile(jumps, 0.95))
    for k in (0, 1):
        if clear[k] and usual[1 - k]:
            return k
    return None


def _jump(time: Float, px: Float, at: float, gap: float) -> float:
    """px, by which lines through the pictures before and after a time +- `gap` are apart there;
    what is common to all tags, as hands move them one by one. NaN where pictures are few."""
    before = np.flatnonzero((time < at - gap) & (time > at - gap - _BESIDE))
    after = np.flatnonzero((time > at + gap) & (time < at + gap + _BESIDE))
    if min(len(before), len(after)) < 3:
        return np.nan
    ends = [_line(time[rows] - at, px[rows]) for rows in (before, after)]
    apart = ends[1] - ends[0]
    good = np.isfinite(apart).all(axis=1)
    return float(np.linalg.norm(np.median(apart[good], axis=0))) if good.any() else np.nan


def _line(t: Float, px: Float) -> Float:
    """Middles (m, 2) at time zero, of lines through those (n, m, 2) at times (n,)."""
    A = np.stack([np.ones(len(t)), t], axis=1)
    return np.asarray((np.linalg.pinv(A) @ px.reshape(len(t), -1))[0].reshape(-1, 2))


@dataclass(frozen=True)
class _Sums:
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
        inverse = np.linalg.inv(self.N[hi, c] - self.N[lo, c] + np.diag(1 / _PRIOR**2))
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


def _change(
    sums: _Sums, c: int, ends: Sequence[int], span: int, takes: int
) -> tuple[float, int, Float] | None:
    """Where frames of one of the spans between `ends` tell of two poses of camera c best: by how
    much two explain the views better than one does, the frame, and the difference; None where that
    is not clear."""
    lo, hi = ends[span], ends[span + 1]
    margin = _SHORTEST + takes
    at = np.arange(lo + margin, hi - margin + 1)
    if not len(at):
        return None
    prior = np.diag(1 / _PRIOR**2)

    def gain(N: Float, g: Float) -> Float:
        return np.asarray((g * np.linalg.solve(N + prior, g[..., None])[..., 0]).sum(-1))

    N, g = sums.N[:, c], sums.g[:, c]
    gains = gain(N[at] - N[lo], g[at] - g[lo]) + gain(N[hi] - N[at], g[hi] - g[at])
    gains -= gain(N[hi] - N[lo], g[hi] - g[lo])
    k = int(at[gains.argmax()])
    scatter = sums.scatter(c, sorted([*ends, k]))
    poses, covariance = [], np.zeros((6, 6))
    for first, last in ((lo, k), (k, hi)):
        pose, inverse = sums.pose(c, first, last)
        poses.append(pose)
        covariance += inverse @ ((last - first) * scatter) @ inverse + sums.inflation * inverse
    d = poses[1] - poses[0]
    chi = float(d @ np.linalg.solve(covariance, d))
    seen = sums.tags[hi, c] - sums.tags[lo, c]
    picture = (sums.picture[hi, c] - sums.picture[lo, c]) / max(seen, 1)
    if chi < _CLEAR or float(np.sqrt(d @ picture @ d)) < _LEAST:
        return None
    return float(gains.max()), k, d


def _as_begun(cameras: Sequence[Camera], views: SharedViews) -> list[Camera]:
    """With the one camera whose pose explains most of what does not fit as it stands on the whole:
    one that was moved before, or is not quite where it was arranged, is not moved on the way."""
    out = list(cameras)
    for _ in range(_ROUNDS):
        sums = _normal_equations(out, views, *_start(out, views.count))
        told = [float(sums.pose(c, 0, views.count)[0] @ sums.g[-1, c]) for c in range(len(out))]
        c = int(np.argmax(told))
        d = sums.pose(c, 0, views.count)[0]
        out[c] = CameraMotion(c, 0, rotations(d[:3]), d[3:]).moved(out[c])
    return out


def _still(views: SharedViews, motions: Sequence[CameraMotion], takes: int) -> SharedViews:
    """Without frames in which a camera is being moved."""
    good = np.ones(len(views.frame), bool)
    for m in motions:
        good &= (views.frame < m.at - takes) | (views.frame >= m.at + takes)
    return replace(
        views,
        frame=views.frame[good],
        corners=views.corners[good],
        variance=views.variance[good],
    )


def _start(cameras: Sequence[Camera], count: int) -> tuple[Float, Float]:
    """Rotations (k, v, 3, 3) and translations (k, v, 3) of the cameras in each frame."""
    R = np.tile(np.stack([c.rotation for c in cameras]), (count, 1, 1, 1))
    return R, np.tile(np.stack([c.translation for c in cameras]), (count, 1, 1))


def _replayed(
    cameras: Sequence[Camera], count: int, motions: Sequence[CameraMotion]
) -> tuple[Float, Float]:
    R, T = _start(cameras, count)
    for m in motions:
        R[m.at :, m.camera] = m.rotation @ R[m.at :, m.camera]
        T[m.at :, m.camera] = T[m.at :, m.camera] @ m.rotation.T + m.translation
    return R, T


def _normal_equations(cameras: Sequence[Camera], views: SharedViews, R: Float, T: Float) -> _Sums:
    """For cameras that stand at R (k, v, 3, 3) and T (k, v, 3) in each frame."""
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
        turn, place = rotations(d[:, :3]) @ turn, place + d[:, 3:]
    chi = (w * (miss**2).sum(axis=(2, 3))).sum(axis=1)
    free = 8 * use.sum(axis=1) - 6
    trust = _trust(chi / free, views)[:, None]
    by = np.concatenate([-D @ cross_matrices(X), D], axis=-1).reshape(n, v, 8, 6)
    wb = w[..., None, None] * by
    across = np.einsum("nvka,nvkb->nvab", wb, own)  # camera by tag
    solved = np.linalg.solve(A[:, None], np.swapaxes(across, 2, 3))
    N = np.einsum("nvka,nvkb->nvab", wb, by) - across @ solved
    g = np.einsum("nvka,nvk->nva", wb, miss.reshape(n, v, 8))
    g -= (across @ np.linalg.solve(A, a[..., None])[:, None])[..., 0]
    N, g = trust[..., None, None] * N, trust[..., None] * g
    picture = np.einsum("nvka,nvkb->nvab", by, by) / 4
    inflation = max(float(np.median(chi / free)), 1.0) if n else 1.0
    N, g, picture, tags = (_by_frame(x, views) for x in (N, g, picture, use.astype(float)))
    return _Sums(N, g, picture, tags, inflation)


def _by_frame(values: Float, views: SharedViews) -> Float:
    """Sums (k + 1, ...) of values (n, ...) of tags over the first so many frames."""
    out = np.zeros((views.count + 1, *values.shape[1:]))
    np.add.at(out, views.frame + 1, values)
    return np.asarray(np.cumsum(out, axis=0))


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


def _orthogonal(R: Float) -> Float:
    u, _, vt = np.linalg.svd(R)
    return np.asarray(u @ vt)
