"""Where one camera's frames fall out of step with another's.

A program that loses frames and writes the rest at a constant rate leaves no gap in the time
stamps: from there on all of them are early. Rays of two cameras to a moving tag miss each other
then, so the offset between the clocks is followed along the video: the least sum of misses from the
epipolar lines, where each change of the offset has its price (Viterbi 1967).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from .observations import Observed, at, middles
from .reconstruction import triangulate

# By how much one camera's clock is behind another's, from moving tags alone.
#
# Rays of two cameras to a moving tag meet only where both saw it at one time. The offset at which
# they miss each other least is found on a grid, then between its points.

_MOST = 300  # tags looked at: those that move most
_LEAST = 30
_COARSE = 60  # of them, on the grid
_AGREE = 1.5  # px: views that miss by more, root mean square, are not of one time
_FINE_CAMERA_OFFSET = 1e-4  # s


@dataclass(frozen=True)
class Offset:
    """`value` s, to be added to the second camera's times; its standard deviation `sigma` s;
    residuals, px, `before` and `after`."""

    value: float
    sigma: float
    before: float
    after: float


def find_offset(
    cameras: Sequence[Camera], first: Observed, second: Observed, reach: float
) -> Offset | None:
    """Of two cameras whose clocks differ by at most `reach` s; None where too little moves, or the
    best is at the end of the reach."""
    period = float(np.median(np.diff(second.time))) if len(second.time) > 2 else 0.0
    rows = _moving(first, second)
    if rows is None or not 0 < period < reach:
        return None

    some, place = np.unique(rows[0], return_inverse=True)
    part = first.part(some)
    ours = part.corners[place, rows[1]], part.covariance[place, rows[1]]

    def miss(offset: float, every: int = 1) -> float:
        frames, tags = rows[0][::every], rows[1][::every]
        corners, covariance = at(second, first.time[frames], offset)
        n = np.arange(len(frames))
        both = np.stack([ours[0][::every], corners[n, tags]], axis=1)
        spread = np.stack([ours[1][::every], covariance[n, tags]], axis=1)
        there = np.isfinite(both).all(axis=(1, 2, 3))
        if there.sum() * every < _LEAST / 2:
            return float("inf")
        found = triangulate(cameras, both[there], spread[there])
        # Those that disagree count with what they may disagree at most.
        m = np.where(np.isfinite(found.miss), found.miss, 2.0)
        return float(np.mean(m**2))

    grid = np.arange(-reach, reach + period / 4, period / 2)
    coarse = max(len(rows[0]) // _COARSE, 1)
    values = np.array([miss(o, coarse) for o in grid])
    k = int(values.argmin())
    if not 0 < k < len(grid) - 1 or not np.isfinite(values[k - 1 : k + 2]).all():
        return None
    low, high = grid[k - 1], grid[k + 1]
    golden = (np.sqrt(5) - 1) / 2
    a, b = high - golden * (high - low), low + golden * (high - low)
    fa, fb = miss(a), miss(b)
    while high - low > _FINE_CAMERA_OFFSET:
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - golden * (high - low)
            fa = miss(a)
        else:
            low, a, fa = a, b, fb
            b = low + golden * (high - low)
            fb = miss(b)
    best = (low + high) / 2
    least, before = miss(best), miss(0.0)
    # Of a parabola through a step to both sides: how sharp the minimum is.
    h = period / 4
    bend = max((miss(best - h) + miss(best + h) - 2 * least) / h**2, 1e-12)
    sigma = float(np.sqrt(2 * least / bend / max(len(rows[0]) - 1, 1)))
    if least > _AGREE**2:
        return None  # nowhere in reach do they see the same
    return Offset(float(best), sigma, float(np.sqrt(before)), float(np.sqrt(least)))


def _moving(first: Observed, second: Observed) -> tuple[Int, Int] | None:
    """Frames of the first camera, and tags, that move most there and that the second sees too."""
    middle = middles(first)
    speed = np.full(middle.shape[:2], np.nan)
    if len(first.time) < 3:
        return None
    span = (first.time[2:] - first.time[:-2])[:, None]
    speed[1:-1] = np.linalg.norm(middle[2:] - middle[:-2], axis=2) / span
    speed[:, ~np.isfinite(middles(second)[..., 0]).any(axis=0)] = np.nan
    good = np.isfinite(speed)
    if good.sum() < _LEAST:
        return None
    order = np.argsort(np.where(good, speed, -1.0), axis=None)[::-1][: min(_MOST, good.sum())]
    frames, tags = np.unravel_index(np.sort(order), speed.shape)
    return frames, tags


_FINE = 8  # offsets tried in a period
_TAGS = 8  # looked at in each frame at most: those that the second camera sees most often
_FRAMES = 5_000  # compared together: what a cache holds
_NOISE = 0.05  # px, least that rays miss each other by
_NOISIEST = 1.0  # px, above which nothing can be told
_CAP = 9.0  # squares of that which a frame counts at most
_GAP = 2.5  # periods, over which places are not interpolated
_PRICE = 16.0  # of a change
_SURE = 8.0  # by which another place of a change must be worse, to be ruled out
_STILL = 0.15  # px: what moves less is the same at both offsets
_WHOLE = 0.3  # periods that a change may differ from whole frames by
_FITS = 3.0  # mean squares of a frame's noise, with which the result is believed


@dataclass(frozen=True)
class FrameDrops:
    """Of the second camera: `time` (t,) s of each of its frames on the first one's clock, NaN where
    that is not certain; the `offsets` (s,) s by which its clock was behind, one after the other,
    and the times `at` (s - 1,) s at which they changed, if they did."""

    time: Float
    offsets: Float
    at: Float


def find_frame_drops(
    cameras: Sequence[Camera], first: Observed, second: Observed, reach: float
) -> FrameDrops | None:
    """Of two cameras whose clocks differ by at most `reach` s; None where the offset does not
    change and all frames fit it, or too little moves to tell."""
    if min(len(first.time), len(second.time)) < 10:
        return None
    period = float(np.median(np.diff(second.time)))
    if not 0 < period < reach:
        return None
    a, b = middles(first), middles(second)
    tags = _often(a, b)
    if not len(tags):
        return None
    a, b = a[:, tags], b[:, tags]
    F = _fundamental(cameras[0], cameras[1])
    grid = np.arange(-reach, reach + 1e-9, period / _FINE)
    # Of an hour these are 100 MB: what follows is written over them.
    cost = np.empty((len(grid), len(a)))
    for begin in range(0, len(a), _FRAMES):
        part = slice(begin, begin + _FRAMES)
        for k, offset in enumerate(grid):
            cost[k, part] = _square(F, a[part], _shown(b, second.time, first.time[part] - offset))
    unknown = ~np.isfinite(cost)
    cost[unknown] = np.inf
    # The camera's own noise, and the calibration's, are what the best offset leaves.
    best = cost.min(axis=0)
    best = best[np.isfinite(best)]
    if len(best) < 10:
        return None
    noise = max(_NOISE**2, 4 * float(np.median(best)))
    if noise > _NOISIEST**2:
        return None  # a camera was moved: then any offset is as good, or as bad
    cost /= noise
    cost[unknown] = 1.0
    np.minimum(cost, _CAP, out=cost)
    path = _cheapest(cost)
    spent = cost[path, np.arange(len(path))]
    alone = cost.sum(axis=1)
    if spent.sum() > 0.7 * alone.min():
        path[:] = alone.argmin()
        spent = cost[path, np.arange(len(path))]
    starts = np.flatnonzero(np.diff(path, prepend=-1))
    # Too few for a change of their own, as at the end: another offset fits them, this one does not.
    doubt = np.asarray((spent > _CAP / 2) & (cost.min(axis=0) < _FITS))
    if spent.mean() > _FITS or (len(starts) < 2 and not doubt.any()):
        return None
    ends = np.append(starts[1:], len(path))
    offsets = np.array([
        grid[path[i]] + _between(cost[:, i:j].sum(axis=1), path[i]) * period / _FINE
        for i, j in zip(starts, ends, strict=True)
    ])  # fmt: skip
    for k in range(1, len(starts)):
        near = slice(starts[k - 1], ends[k])
        unsure = np.zeros(len(path), bool)
        unsure[near] = _doubtful(
            cost[:, near], path[starts[k - 1]], path[starts[k]], starts[k] - starts[k - 1]
        )
        x, y = (_shown(b, second.time, first.time - offsets[n]) for n in (k - 1, k))
        move = np.where(np.isfinite(x - y), np.abs(x - y), 0.0).max(axis=(1, 2))
        doubt |= unsure & (move > _STILL)
    edges = np.append(first.time[starts], np.inf)
    edges[0] = -np.inf
    time = _placed(second.time, offsets, edges, first.time[doubt], period)
    # Where the second camera has nothing to show, an offset costs nothing and says nothing.
    ahead, behind = edges[:-1] - period / 2, edges[1:] - period / 2
    told = ((time >= ahead[:, None]) & (time < behind[:, None])).any(axis=1)
    jumps = np.diff(offsets[told]) / period
    if (np.abs(jumps - np.round(jumps)) > _WHOLE).any():
        return None  # no frames were lost: a camera was moved
    return FrameDrops(time, offsets[told], first.time[starts[told]][1:])


def _often(first: Float, second: Float) -> Int:
    """Tags that both see, by their places (t, m, 2), those first that the second sees most
    often."""
    count = np.minimum(*(np.isfinite(s[..., 0]).sum(axis=0) for s in (first, second)))
    order = np.argsort(-count, kind="stable")[:_TAGS]
    return np.asarray(order[count[order] >= 5])


def _fundamental(first: Camera, second: Camera) -> Float:
    """Matrix (3, 3) with x2 F x1 = 0 for undistorted pixels of one point in both."""
    R = second.rotation @ first.rotation.T
    t = second.translation - R @ first.translation
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    return np.asarray(np.linalg.inv(second.matrix).T @ cross @ R @ np.linalg.inv(first.matrix))


def _shown(places: Float, time: Float, at: Float) -> Float:
    """Places (t, m, 2) px at other times, linear between frames; NaN beyond and beside gaps."""
    k = np.clip(np.searchsorted(time, at) - 1, 0, len(time) - 2)
    w = ((at - time[k]) / (time[k + 1] - time[k]))[:, None, None]
    far = np.diff(time)[k][:, None, None] > _GAP * np.median(np.diff(time))
    w = np.where((w < -1e-6) | (w > 1 + 1e-6) | far, np.nan, w)
    return np.asarray((1 - w) * places[k] + w * places[k + 1])


def _square(F: Float, a: Float, b: Float) -> Float:
    """Mean squares (t,) px^2 of how far tags (t, m, 2) are from the epipolar lines, by Sampson's
    first-order distance; NaN where there is no tag."""
    one = np.ones((*a.shape[:2], 1))
    x, y = np.concatenate([a, one], axis=2), np.concatenate([b, one], axis=2)
    line, other = x @ F.T, y @ F
    off = (y * line).sum(axis=2) ** 2
    square = off / ((line[..., :2] ** 2).sum(axis=2) + (other[..., :2] ** 2).sum(axis=2))
    there = np.isfinite(square)
    count = there.sum(axis=1)
    total = np.where(there, square, 0.0).sum(axis=1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def _cheapest(cost: Float) -> Int:
    """Of costs (o, t): the offset of each frame (t,)."""
    count, frames = cost.shape
    least = cost[:, 0].copy()
    came = np.zeros((frames, count), np.uint8 if count <= 256 else np.int64)
    stay = np.arange(count)
    for k in range(1, frames):
        from_ = int(least.argmin())
        change = least[from_] + _PRICE < least
        came[k] = np.where(change, from_, stay)
        least = np.where(change, least[from_] + _PRICE, least) + cost[:, k]
    path = np.zeros(frames, np.int64)
    path[-1] = least.argmin()
    for k in range(frames - 1, 0, -1):
        path[k - 1] = came[k, path[k]]
    return path


def _between(cost: Float, k: int) -> float:
    """Where a parabola through three offsets is least, in steps from the middle one."""
    if not 0 < k < len(cost) - 1:
        return 0.0
    bend = cost[k - 1] + cost[k + 1] - 2 * cost[k]
    return float(np.clip((cost[k - 1] - cost[k + 1]) / (2 * bend), -0.5, 0.5)) if bend > 0 else 0.0


def _doubtful(cost: Float, before: int, after: int, change: int) -> Bool:
    """Frames (t,) that may as well belong to the other side of a change."""
    gain = np.concatenate([[0.0], np.cumsum(cost[before] - cost[after])])
    likely = np.flatnonzero(gain <= gain[change] + _SURE)
    # Only without a wall between: far away the same price may be paid for something else.
    low = high = change
    while low - 1 in likely:
        low -= 1
    while high + 1 in likely:
        high += 1
    out = np.zeros(cost.shape[1], bool)
    out[low:high] = True
    return out


def _placed(time: Float, offsets: Float, edges: Float, doubt: Float, period: float) -> Float:
    """Times (t,) on the first camera's clock: each frame by the stretch in which it then lies."""
    out = np.full(len(time), np.nan)
    for k, offset in enumerate(offsets):
        there = time + offset
        mine = (there >= edges[k] - 0.5 * period) & (there < edges[k + 1] - 0.5 * period)
        out[mine & np.isnan(out)] = there[mine & np.isnan(out)]
    if len(doubt):
        near = np.clip(np.searchsorted(doubt, out), 1, len(doubt)) - 1
        gap = np.minimum(np.abs(out - doubt[near]),
                         np.abs(out - doubt[np.minimum(near + 1, len(doubt) - 1)]))  # fmt: skip
        out[gap <= 0.75 * period] = np.nan
    last = -np.inf
    for k, t in enumerate(out):
        if t <= last + 0.25 * period:
            out[k] = np.nan
        elif t > last:
            last = t
    return out
