"""Find how two cameras' clocks differ, from moving tags alone.

Rays of two cameras to a moving tag meet only if both saw it at the same time. `find_offset` finds
the constant offset at which they miss each other least, first on a grid and then between its
points.

A program that loses frames and writes the rest at a constant rate leaves no gap in the time stamps:
all later stamps are early. `find_frame_drops` follows the offset along the video. It minimizes the
sum of distances from the epipolar lines, in which each change of the offset has a cost (Viterbi
1967).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from .observations import ObservationSource, interpolate, tag_centers
from .reconstruction import triangulate

MAX_OFFSET_TAGS = 300  # used for the offset: those that move most
MIN_OFFSET_TAGS = 30
COARSE_TAGS = 60  # of these tags, used on the grid
MAX_AGREEMENT_PX = 1.5  # root mean square; views that miss by more are not of the same time
OFFSET_RESOLUTION_S = 1e-4


@dataclass(frozen=True)
class Offset:
    """Offset between two cameras' clocks.

    Attributes:
        value: Time to add to the second camera's times, s.
        sigma: Its standard deviation, s.
        before: Residual without the offset, px.
        after: Residual with the offset, px.
    """

    value: float
    sigma: float
    before: float
    after: float


def find_offset(
    cameras: Sequence[Camera], first: ObservationSource, second: ObservationSource, reach: float
) -> Offset | None:
    """Find a constant offset between the clocks of two cameras.

    Args:
        cameras: The two cameras.
        first: Observations of the first camera.
        second: Observations of the second camera.
        reach: Largest difference of the clocks, s.

    Returns:
        The offset; None if too little moves, or the best offset is at the end of the reach.
    """
    period = float(np.median(np.diff(second.time))) if len(second.time) > 2 else 0.0
    rows = _moving_tags(first, second)
    if rows is None or not 0 < period < reach:
        return None

    frames_used, position = np.unique(rows[0], return_inverse=True)
    first_part = first.part(frames_used)
    first_views = first_part.corners[position, rows[1]], first_part.covariance[position, rows[1]]

    def miss(offset: float, stride: int = 1) -> float:
        frames, tags = rows[0][::stride], rows[1][::stride]
        corners, covariance = interpolate(second, first.time[frames], offset)
        n = np.arange(len(frames))
        views = np.stack([first_views[0][::stride], corners[n, tags]], axis=1)
        covariances = np.stack([first_views[1][::stride], covariance[n, tags]], axis=1)
        is_known = np.isfinite(views).all(axis=(1, 2, 3))
        if is_known.sum() * stride < MIN_OFFSET_TAGS / 2:
            return float("inf")
        located = triangulate(cameras, views[is_known], covariances[is_known])
        # Views that disagree count with the largest possible disagreement.
        misses = np.where(np.isfinite(located.miss), located.miss, 2.0)
        return float(np.mean(misses**2))

    grid = np.arange(-reach, reach + period / 4, period / 2)
    coarse = max(len(rows[0]) // COARSE_TAGS, 1)
    values = np.array([miss(o, coarse) for o in grid])
    k = int(values.argmin())
    if not 0 < k < len(grid) - 1 or not np.isfinite(values[k - 1 : k + 2]).all():
        return None
    low, high = grid[k - 1], grid[k + 1]
    golden = (np.sqrt(5) - 1) / 2
    a, b = high - golden * (high - low), low + golden * (high - low)
    fa, fb = miss(a), miss(b)
    while high - low > OFFSET_RESOLUTION_S:
        if fa < fb:
            high, b, fb = b, a, fa
            a = high - golden * (high - low)
            fa = miss(a)
        else:
            low, a, fa = a, b, fb
            b = low + golden * (high - low)
            fb = miss(b)
    offset_found = (low + high) / 2
    cost_after, cost_before = miss(offset_found), miss(0.0)
    # The sharpness of the minimum, by a parabola through a step on each side.
    step = period / 4
    curvature = max(
        (miss(offset_found - step) + miss(offset_found + step) - 2 * cost_after) / step**2, 1e-12
    )
    sigma = float(np.sqrt(2 * cost_after / curvature / max(len(rows[0]) - 1, 1)))
    if cost_after > MAX_AGREEMENT_PX**2:
        return None  # the cameras agree at no offset within reach
    return Offset(
        float(offset_found), sigma, float(np.sqrt(cost_before)), float(np.sqrt(cost_after))
    )


def _moving_tags(first: ObservationSource, second: ObservationSource) -> tuple[Int, Int] | None:
    """Return frames of the first camera and tags that move most there and that both cameras see."""
    centers = tag_centers(first)
    speed = np.full(centers.shape[:2], np.nan)
    if len(first.time) < 3:
        return None
    duration = (first.time[2:] - first.time[:-2])[:, None]
    speed[1:-1] = np.linalg.norm(centers[2:] - centers[:-2], axis=2) / duration
    speed[:, ~np.isfinite(tag_centers(second)[..., 0]).any(axis=0)] = np.nan
    is_known = np.isfinite(speed)
    if is_known.sum() < MIN_OFFSET_TAGS:
        return None
    order = np.argsort(np.where(is_known, speed, -1.0), axis=None)[::-1][
        : min(MAX_OFFSET_TAGS, is_known.sum())
    ]
    frames, tags = np.unravel_index(np.sort(order), speed.shape)
    return frames, tags


STEPS_PER_PERIOD = 8  # of the grid of offsets
MAX_FRAME_TAGS = 8  # those that the second camera sees most often
BLOCK_FRAMES = 5_000  # compared together, to fit in the cache
MIN_NOISE_PX = 0.05  # by which rays miss each other
MAX_NOISE_PX = 1.0  # above it no offset can be found
# Costs are squares of the noise.
MAX_FRAME_COST = 9.0
CHANGE_COST = 16.0
CERTAIN_COST_DIFFERENCE = 8.0  # by which another position of a change must be worse to be ruled out
MAX_MEAN_COST = 3.0  # of a credible result
MAX_GAP_PERIODS = 2.5  # over which positions are not interpolated
MIN_MOTION_PX = 0.15  # less motion is the same at both offsets
MAX_STEP_FRACTION = 0.3  # of a change from whole periods


@dataclass(frozen=True)
class FrameDrops:
    """Times of the second camera's frames on the first camera's clock.

    Attributes:
        time: Time of each frame (t,), s, NaN if it is uncertain.
        offsets: Successive offsets of its clock (s,), s.
        change_times: Times at which they changed (s - 1,), s.
    """

    time: Float
    offsets: Float
    change_times: Float


def find_frame_drops(
    cameras: Sequence[Camera], first: ObservationSource, second: ObservationSource, reach: float
) -> FrameDrops | None:
    """Find where a camera lost frames.

    Args:
        cameras: The two cameras.
        first: Observations of the first camera.
        second: Observations of the second camera, which may have lost frames.
        reach: Largest difference of the clocks, s.

    Returns:
        The frames' times; None if the offset is constant and fits all frames, or if too little
        moves.
    """
    if min(len(first.time), len(second.time)) < 10:
        return None
    period = float(np.median(np.diff(second.time)))
    if not 0 < period < reach:
        return None
    first_centers, second_centers = tag_centers(first), tag_centers(second)
    tags = _frequent_tags(first_centers, second_centers)
    if not len(tags):
        return None
    first_centers, second_centers = first_centers[:, tags], second_centers[:, tags]
    F = _fundamental(cameras[0], cameras[1])
    grid = np.arange(-reach, reach + 1e-9, period / STEPS_PER_PERIOD)
    # 100 MB for an hour, so later results overwrite it.
    cost = np.empty((len(grid), len(first_centers)))
    for start in range(0, len(first_centers), BLOCK_FRAMES):
        block = slice(start, start + BLOCK_FRAMES)
        for k, offset in enumerate(grid):
            cost[k, block] = _epipolar_squares(
                F,
                first_centers[block],
                _interpolate_centers(second_centers, second.time, first.time[block] - offset),
            )
    is_unknown = ~np.isfinite(cost)
    cost[is_unknown] = np.inf
    # The best offset leaves the noise of camera and calibration.
    best = cost.min(axis=0)
    best = best[np.isfinite(best)]
    if len(best) < 10:
        return None
    noise = max(MIN_NOISE_PX**2, 4 * float(np.median(best)))
    if noise > MAX_NOISE_PX**2:
        return None  # a camera was moved, so all offsets fit alike
    cost /= noise
    cost[is_unknown] = 1.0
    np.minimum(cost, MAX_FRAME_COST, out=cost)
    path = _cheapest_path(cost)
    frame_cost = cost[path, np.arange(len(path))]
    constant_cost = cost.sum(axis=1)
    if frame_cost.sum() > 0.7 * constant_cost.min():
        path[:] = constant_cost.argmin()
        frame_cost = cost[path, np.arange(len(path))]
    starts = np.flatnonzero(np.diff(path, prepend=-1))
    # Frames that fit another offset, but are too few for a change, for example at the end.
    is_doubtful = np.asarray((frame_cost > MAX_FRAME_COST / 2) & (cost.min(axis=0) < MAX_MEAN_COST))
    if frame_cost.mean() > MAX_MEAN_COST or (len(starts) < 2 and not is_doubtful.any()):
        return None
    ends = np.append(starts[1:], len(path))
    offsets = np.array(
        [
            grid[path[i]]
            + _parabola_minimum(cost[:, i:j].sum(axis=1), path[i]) * period / STEPS_PER_PERIOD
            for i, j in zip(starts, ends, strict=True)
        ]
    )
    for k in range(1, len(starts)):
        nearby = slice(starts[k - 1], ends[k])
        is_unsure = np.zeros(len(path), bool)
        is_unsure[nearby] = _doubtful_frames(
            cost[:, nearby], path[starts[k - 1]], path[starts[k]], starts[k] - starts[k - 1]
        )
        x, y = (
            _interpolate_centers(second_centers, second.time, first.time - offsets[n])
            for n in (k - 1, k)
        )
        motion = np.where(np.isfinite(x - y), np.abs(x - y), 0.0).max(axis=(1, 2))
        is_doubtful |= is_unsure & (motion > MIN_MOTION_PX)
    edges = np.append(first.time[starts], np.inf)
    edges[0] = -np.inf
    time = _map_times(second.time, offsets, edges, first.time[is_doubtful], period)
    # An offset without frames of the second camera has no cost and no meaning.
    from_time, to_time = edges[:-1] - period / 2, edges[1:] - period / 2
    is_present = ((time >= from_time[:, None]) & (time < to_time[:, None])).any(axis=1)
    steps = np.diff(offsets[is_present]) / period
    if (np.abs(steps - np.round(steps)) > MAX_STEP_FRACTION).any():
        return None  # not lost frames, but a camera that was moved
    return FrameDrops(time, offsets[is_present], first.time[starts[is_present]][1:])


def _frequent_tags(first: Float, second: Float) -> Int:
    """Return tags that both cameras see, by their centers (t, m, 2).

    Tags that are seen most often come first.
    """
    count = np.minimum(*(np.isfinite(s[..., 0]).sum(axis=0) for s in (first, second)))
    order = np.argsort(-count, kind="stable")[:MAX_FRAME_TAGS]
    return np.asarray(order[count[order] >= 5])


def _fundamental(first: Camera, second: Camera) -> Float:
    """Return the matrix (3, 3) with x2 F x1 = 0 for undistorted pixels of one point in both."""
    R = second.rotation @ first.rotation.T
    t = second.translation - R @ first.translation
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    return np.asarray(np.linalg.inv(second.matrix).T @ cross @ R @ np.linalg.inv(first.matrix))


def _interpolate_centers(centers: Float, time: Float, other_time: Float) -> Float:
    """Interpolate centers (t, m, 2), px, linearly; NaN outside of the frames and near gaps."""
    k = np.clip(np.searchsorted(time, other_time) - 1, 0, len(time) - 2)
    share = ((other_time - time[k]) / (time[k + 1] - time[k]))[:, None, None]
    is_far = np.diff(time)[k][:, None, None] > MAX_GAP_PERIODS * np.median(np.diff(time))
    share = np.where((share < -1e-6) | (share > 1 + 1e-6) | is_far, np.nan, share)
    return np.asarray((1 - share) * centers[k] + share * centers[k + 1])


def _epipolar_squares(F: Float, first: Float, second: Float) -> Float:
    """Return mean squared distances of tags from the epipolar lines (t,), px^2.

    The distance is Sampson's first-order distance; it is NaN without tags.
    """
    one = np.ones((*first.shape[:2], 1))
    x, y = np.concatenate([first, one], axis=2), np.concatenate([second, one], axis=2)
    line, other = x @ F.T, y @ F
    errors = (y * line).sum(axis=2) ** 2
    square = errors / ((line[..., :2] ** 2).sum(axis=2) + (other[..., :2] ** 2).sum(axis=2))
    is_known = np.isfinite(square)
    count = is_known.sum(axis=1)
    total = np.where(is_known, square, 0.0).sum(axis=1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def _cheapest_path(cost: Float) -> Int:
    """Return the offset of each frame (t,) that minimizes costs (o, t) and those of changes."""
    count, frames = cost.shape
    total = cost[:, 0].copy()
    origin = np.zeros((frames, count), np.uint8 if count <= 256 else np.int64)
    same = np.arange(count)
    for k in range(1, frames):
        cheapest = int(total.argmin())
        change = total[cheapest] + CHANGE_COST < total
        origin[k] = np.where(change, cheapest, same)
        total = np.where(change, total[cheapest] + CHANGE_COST, total) + cost[:, k]
    path = np.zeros(frames, np.int64)
    path[-1] = total.argmin()
    for k in range(frames - 1, 0, -1):
        path[k - 1] = origin[k, path[k]]
    return path


def _parabola_minimum(cost: Float, k: int) -> float:
    """Return where a parabola through three offsets is least, in steps from the middle one."""
    if not 0 < k < len(cost) - 1:
        return 0.0
    curvature = cost[k - 1] + cost[k + 1] - 2 * cost[k]
    return (
        float(np.clip((cost[k - 1] - cost[k + 1]) / (2 * curvature), -0.5, 0.5))
        if curvature > 0
        else 0.0
    )


def _doubtful_frames(cost: Float, before: int, after: int, change: int) -> Bool:
    """Return frames (t,) that may as well belong to the other side of a change."""
    gain = np.concatenate([[0.0], np.cumsum(cost[before] - cost[after])])
    possible = np.flatnonzero(gain <= gain[change] + CERTAIN_COST_DIFFERENCE)
    # Only contiguous frames: far away the same cost may have another reason.
    low = high = change
    while low - 1 in possible:
        low -= 1
    while high + 1 in possible:
        high += 1
    out = np.zeros(cost.shape[1], bool)
    out[low:high] = True
    return out


def _map_times(
    time: Float, offsets: Float, edges: Float, doubtful_times: Float, period: float
) -> Float:
    """Return times (t,), s, on the first camera's clock, by the offset of the span that contains
    them.
    """
    mapped = np.full(len(time), np.nan)
    for k, offset in enumerate(offsets):
        shifted = time + offset
        is_in_span = (shifted >= edges[k] - 0.5 * period) & (shifted < edges[k + 1] - 0.5 * period)
        mapped[is_in_span & np.isnan(mapped)] = shifted[is_in_span & np.isnan(mapped)]
    if len(doubtful_times):
        nearest = np.clip(np.searchsorted(doubtful_times, mapped), 1, len(doubtful_times)) - 1
        distance = np.minimum(
            np.abs(mapped - doubtful_times[nearest]),
            np.abs(mapped - doubtful_times[np.minimum(nearest + 1, len(doubtful_times) - 1)]),
        )
        mapped[distance <= 0.75 * period] = np.nan
    previous = -np.inf
    for k, t in enumerate(mapped):
        if t <= previous + 0.25 * period:
            mapped[k] = np.nan
        elif t > previous:
            previous = t
    return mapped
