"""When a camera was moved while it recorded, and by how much, from the tags alone.

A tag is a square of known size: views of it tell how the cameras stand to each other, in depth too,
where their rays would still meet. A move is where two spans of frames differ by far more than
pieces of them do among themselves: errors of the lens model change with the tags' places, too, but
not for good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.camera import Camera, rotation_matrices
from .pose_equations import PRIOR, PoseEquations, SharedViews, pose_equations

_MOVES = 6  # that are looked for, at most
_SHORTEST = 12  # frames of a span, but for those in which a camera is moved
_CLEAR = 60.0  # chi square of a change that is no chance
_LEAST = 0.4  # px, by which it moves the picture
_BESIDE = 0.2  # s, of which the pictures beside a move are continued
_TELLS = 1.5  # times as far as pictures jump by at other times, that is clear
_TIMES = 60  # others
_ROUNDS = 2  # in which all moves are measured together


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
        sums = pose_equations(cameras, _still(views, found, takes), R, T)
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
        motion = CameraMotion(c, at, rotation_matrices(d[:3]), d[3:])
        found = sorted([*found, motion], key=lambda m: m.at)
        R, T = _replayed(cameras, views.count, found)
    for _ in range(_ROUNDS if found else 0):
        for k, m in enumerate(found):
            sums = pose_equations(cameras, _still(views, found, takes), R, T)
            lo = found[k - 1].at if k else 0
            hi = found[k + 1].at if k + 1 < len(found) else views.count
            d = sums.pose(m.camera, m.at, hi)[0] - sums.pose(m.camera, lo, m.at)[0]
            turn = rotation_matrices(d[:3])
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
        most = np.quantile(jumps, 0.95)
        clear.append(here > _TELLS * most)
        usual.append(here < most)
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


def _change(
    sums: PoseEquations, c: int, ends: Sequence[int], span: int, takes: int
) -> tuple[float, int, Float] | None:
    """Where frames of one of the spans between `ends` tell of two poses of camera c best: by how
    much two explain the views better than one does, the frame, and the difference; None where that
    is not clear."""
    lo, hi = ends[span], ends[span + 1]
    margin = _SHORTEST + takes
    at = np.arange(lo + margin, hi - margin + 1)
    if not len(at):
        return None
    prior = np.diag(1 / PRIOR**2)

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
        sums = pose_equations(out, views, *_start(out, views.count))
        told = [float(sums.pose(c, 0, views.count)[0] @ sums.g[-1, c]) for c in range(len(out))]
        c = int(np.argmax(told))
        d = sums.pose(c, 0, views.count)[0]
        out[c] = CameraMotion(c, 0, rotation_matrices(d[:3]), d[3:]).moved(out[c])
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


def _orthogonal(R: Float) -> Float:
    u, _, vt = np.linalg.svd(R)
    return np.asarray(u @ vt)
