"""Synchronize cameras with the first one, by how the tags move.

Rays of two cameras to a moving tag meet only if both saw it at the same time. `find_offset` finds
the constant offset at which they miss each other least, first on a grid and then between its
points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ..cameras.rig_file import Rig
from ..tracking.observations import (
    StoredObservations,
    frame_blocks,
    interpolate,
    tag_centers,
)
from ..tracking.reconstruction import triangulate

MAX_CLOCK_OFFSET_S, MIN_CORRECTION_S = 0.25, 1e-3
MAX_START_OFFSET_S = 10.0  # between videos that were started manually
#: Of a credible offset: largest residual, and its ratio to the residual without the offset.
MAX_RESIDUAL_PX, MAX_RESIDUAL_RATIO = 0.5, 0.5
Count = NDArray[np.int8]  # number of cameras for each tag in each frame, a byte to save memory
MIN_MOTION_PX = 0.5  # of a tag, during which a repeated image is wrong
MAX_OFFSET_TAGS = 300  # used for the offset: those that move most
MIN_OFFSET_TAGS = 30
COARSE_TAGS = 60  # of these tags, used on the grid
_BLOCK_VIEWS = 80_000  # that are interpolated at once for the grid, to limit memory
MAX_AGREEMENT_PX = 1.5  # root mean square; views that miss by more are not of the same time
OFFSET_RESOLUTION_S = 1e-4


class TrackWarning(str):
    """A warning about tracks: a text with a stable code.

    Attributes:
        code: Identifier of the kind of problem.
    """

    code: str

    def __new__(cls, text: str, code: str) -> TrackWarning:
        """Create a warning from its text and code."""
        warning = super().__new__(cls, text)
        warning.code = code
        return warning


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
    cameras: Sequence[Camera], first: StoredObservations, second: StoredObservations, reach: float
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

    def misses(offsets: Float, stride: int = 1) -> Float:
        """Return the mean squared misses (k,) px^2 at offsets (k,) s."""
        frames, tags = rows[0][::stride], np.tile(rows[1][::stride], len(offsets))
        corners, covariance = interpolate(second, (first.time[frames] - offsets[:, None]).ravel())
        n = np.arange(len(tags))
        of_first = [np.tile(v[::stride], (len(offsets), *[1] * (v.ndim - 1))) for v in first_views]
        views = np.stack([of_first[0], corners[n, tags]], axis=1)
        covariances = np.stack([of_first[1], covariance[n, tags]], axis=1)
        is_known = np.isfinite(views).all(axis=(1, 2, 3))
        located = triangulate(cameras, views[is_known], covariances[is_known])
        square = np.zeros(len(tags))
        # Views that disagree count with the largest possible disagreement.
        square[is_known] = np.where(np.isfinite(located.miss), located.miss, 2.0) ** 2
        count = is_known.reshape(len(offsets), -1).sum(axis=1)
        mean = square.reshape(len(offsets), -1).sum(axis=1) / np.maximum(count, 1)
        return np.where(count * stride < MIN_OFFSET_TAGS / 2, np.inf, mean)

    def miss(offset: float) -> float:
        return float(misses(np.array([offset]))[0])

    grid = np.arange(-reach, reach + period / 4, period / 2)
    coarse = max(len(rows[0]) // COARSE_TAGS, 1)
    per_block = max(_BLOCK_VIEWS * coarse // (len(rows[0]) * len(second.ids)), 1)
    values = np.concatenate(
        [misses(grid[k : k + per_block], coarse) for k in range(0, len(grid), per_block)]
    )
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
    # The sharpness of the minimum, by a parabola through a step on each side.
    step = period / 4
    cost_after, cost_before, earlier, later = misses(
        np.array([offset_found, 0.0, offset_found - step, offset_found + step])
    )
    if cost_after > MAX_AGREEMENT_PX**2:
        return None  # the cameras agree at no offset within reach
    curvature = max((earlier + later - 2 * cost_after) / step**2, 1e-12)
    sigma = float(np.sqrt(2 * cost_after / curvature / max(len(rows[0]) - 1, 1)))
    return Offset(
        float(offset_found), sigma, float(np.sqrt(cost_before)), float(np.sqrt(cost_after))
    )


def _moving_tags(first: StoredObservations, second: StoredObservations) -> tuple[Int, Int] | None:
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


@dataclass(frozen=True)
class CameraSync:
    """Observations of v cameras on the first one's clock.

    Attributes:
        by_camera: Observations of each camera (v,).
        shift: Times that were added to those of each camera (v,), s.
        repeated_frames: Number of frames of each camera that repeat the previous image (v,).
    """

    by_camera: list[StoredObservations]
    shift: list[float]
    repeated_frames: list[int]

    def warnings(self, names: Sequence[str], offsets_given: bool) -> list[TrackWarning]:
        """Return the warnings.

        Args:
            names: Names of the cameras.
            offsets_given: Whether the offsets were given.
        """
        notes = [
            TrackWarning(
                f"{name}: {count} frames repeat the previous image while tags move, and were left"
                " out. Check that the video is not damaged and the computer is fast enough.",
                "frames-repeated",
            )
            for name, count in zip(names, self.repeated_frames, strict=True)
            if count
        ]
        if not offsets_given and any(self.shift):
            ms = ", ".join(f"{1e3 * s:+.1f}" for s in self.shift)
            notes.append(
                TrackWarning(
                    f"The videos were not synchronous: {ms} ms were added to their times, by how"
                    " the tags move.",
                    "videos-not-synchronous",
                )
            )
        return notes


def sync_cameras(
    rig: Rig,
    by_camera: Sequence[StoredObservations],
    *,
    offsets_given: bool,
    excluded: int | None = None,
) -> CameraSync:
    """Synchronize cameras with the first one.

    Args:
        rig: The cameras.
        by_camera: Observations of each camera.
        offsets_given: Whether the offsets were given, so they stay.
        excluded: A camera that is left out. If it is the first, the second one's clock is used.
    """
    if excluded is not None:
        return _sync_other_cameras(rig, by_camera, excluded, offsets_given=offsets_given)
    by_camera, repeated_frames = _remove_repeats(by_camera)
    shift, synchronized = [0.0], [by_camera[0]]
    for c, observations in enumerate(by_camera[1:], 1):
        pair = [rig.cameras[0], rig.cameras[c]]
        offset = (
            None
            if offsets_given
            else find_offset(pair, by_camera[0], observations, MAX_CLOCK_OFFSET_S)
        )
        start_offset = 0.0
        if not offsets_given and (offset is None or offset.after >= MAX_RESIDUAL_PX):
            start_offset = _start_offset(pair, by_camera[0], observations)
        if start_offset:
            observations = replace(observations, time=observations.time + start_offset)
            offset = find_offset(pair, by_camera[0], observations, MAX_CLOCK_OFFSET_S)
        is_late = (
            offset is not None
            and abs(offset.value) > max(MIN_CORRECTION_S, 4 * offset.sigma)
            and offset.after < MAX_RESIDUAL_RATIO * offset.before
            and offset.after < MAX_RESIDUAL_PX
        )
        correction = offset.value if offset is not None and is_late else 0.0
        shift.append(start_offset + correction)
        synchronized.append(replace(observations, time=observations.time + correction))
    return CameraSync(synchronized, shift, repeated_frames)


def _sync_other_cameras(
    rig: Rig, by_camera: Sequence[StoredObservations], excluded: int, *, offsets_given: bool
) -> CameraSync:
    """Synchronize all cameras but one, which gets no observations."""
    included = [c for c in range(len(by_camera)) if c != excluded]
    others = sync_cameras(
        Rig(tuple(rig.cameras[c] for c in included)),
        [by_camera[c] for c in included],
        offsets_given=offsets_given,
    )
    removed = by_camera[excluded]
    nothing = removed.without(np.ones(len(removed.time), bool))
    return CameraSync(
        [*others.by_camera[:excluded], nothing, *others.by_camera[excluded:]],
        [*others.shift[:excluded], 0.0, *others.shift[excluded:]],
        [*others.repeated_frames[:excluded], 0, *others.repeated_frames[excluded:]],
    )


def _start_offset(
    pair: list[Camera], first: StoredObservations, second: StoredObservations
) -> float:
    """Return by how much the second video started later, s, if more than clocks differ."""
    offset = find_offset(pair, first, second, MAX_START_OFFSET_S)
    if (
        offset is None
        or abs(offset.value) <= MAX_CLOCK_OFFSET_S - 0.05
        or offset.after > MAX_RESIDUAL_PX
    ):
        return 0.0
    return offset.value if offset.after < MAX_RESIDUAL_RATIO * offset.before else 0.0


def views_at_frames(by_camera: Sequence[StoredObservations], frames: Int) -> tuple[Float, Float]:
    """Return the views of all cameras at the times of frames (k,) of the first one.

    Returns:
        Corners (k, m, v, 4, 2), px, and covariances (k, m, v, 5, 2, 2), px^2.
    """
    first = by_camera[0].part(frames)
    parts = [
        (first.corners, first.covariance),
        *(interpolate(s, first.time) for s in by_camera[1:]),
    ]
    return np.stack([p[0] for p in parts], axis=2), np.stack([p[1] for p in parts], axis=2)


def views_of_tags(by_camera: Sequence[StoredObservations], rows: Int) -> tuple[Float, Float]:
    """Return the views of single tags by all cameras.

    Args:
        by_camera: Observations of each camera.
        rows: Frames of the first camera and tags (n, 2).

    Returns:
        Corners (n, v, 4, 2), px, and covariances (n, v, 5, 2, 2), px^2.
    """
    frames, place = np.unique(rows[:, 0], return_inverse=True)
    corners, covariance = views_at_frames(by_camera, frames)
    return corners[place, rows[:, 1]], covariance[place, rows[:, 1]]


def _remove_repeats(
    by_camera: Sequence[StoredObservations],
) -> tuple[list[StoredObservations], list[int]]:
    """Remove frames that repeat the previous image although tags move.

    Motion shows in the camera's next image, or in another camera.
    """
    out, counts = [], []
    for c, observations in enumerate(by_camera):
        is_wrong = np.zeros(len(observations.time), bool)
        for start, end in _repeated_runs(observations):
            corners = observations.part(
                np.arange(start, min(end + 1, len(observations.time)))[[0, -1]]
            ).corners
            after = corners[1] if end < len(observations.time) else np.full_like(corners[0], np.nan)
            if _has_moved(corners[0], after) or any(
                _tags_move(other, observations.time[start], observations.time[end - 1])
                for k, other in enumerate(by_camera)
                if k != c
            ):
                is_wrong[start + 1 : end] = True
        counts.append(int(is_wrong.sum()))
        # Others are interpolated; the first determines the frames.
        out.append(observations.only(~is_wrong) if c else observations.without(is_wrong))
    return out, counts


def _repeated_runs(observations: StoredObservations) -> list[tuple[int, int]]:
    """Return runs of frames (from, to) in which all tags are at exactly the same place."""
    is_same = np.zeros(max(len(observations.time) - 1, 0), bool)
    for frames in frame_blocks(len(is_same), len(observations.ids)):
        flat = observations.part(np.append(frames, frames[-1] + 1)).corners.reshape(
            len(frames) + 1, -1
        )
        is_visible = np.isfinite(flat)
        is_equal = ((flat[1:] == flat[:-1]) | ~(is_visible[1:] | is_visible[:-1])).all(axis=1)
        is_same[frames] = is_equal & is_visible[1:].any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_same, [False]]).astype(int)))
    return [(int(start), int(end) + 1) for start, end in edges.reshape(-1, 2)]


def _has_moved(a: Float, b: Float) -> Bool:
    return np.asarray((np.abs(a - b) > MIN_MOTION_PX).any())


def _tags_move(observations: StoredObservations, start: float, end: float) -> bool:
    """Return whether tags move in a camera between two times, s."""
    rows = np.flatnonzero((observations.time >= start) & (observations.time <= end))
    if len(rows) < 2:
        return False
    first = observations.part(rows[:1]).corners
    parts = (rows[1:][k] for k in frame_blocks(len(rows) - 1, len(observations.ids)))
    return any(bool(_has_moved(observations.part(part).corners, first)) for part in parts)
