"""Synchronize cameras with the first one, by how the tags move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ..cameras.rig_file import Rig
from ..tracking.camera_clocks import FrameDrops, find_frame_drops, find_offset
from ..tracking.observations import ObservationSource, StoredObservations, frame_blocks, interpolate

MAX_CLOCK_OFFSET_S, MIN_CORRECTION_S = 0.25, 1e-3
MAX_START_OFFSET_S = 10.0  # between videos that were started manually
#: Of a credible offset: largest residual, and its ratio to the residual without the offset.
MAX_RESIDUAL_PX, MAX_RESIDUAL_RATIO = 0.5, 0.5
MAX_UNNOTED_FRAMES = 3
Count = NDArray[np.int8]  # number of cameras for each tag in each frame, a byte to save memory
MIN_MOTION_PX = 0.5  # of a tag, during which a repeated image is wrong


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
class CameraSync:
    """Observations of v cameras on the first one's clock.

    Attributes:
        seen: Observations of each camera (v,).
        shift: Times that were added to those of each camera (v,), s.
        steps: By camera: its times, if the offset changed during the recording.
        repeated_frames: Number of frames of each camera that repeat the previous image (v,).
        unmatched_frames: Number of frames of each camera that fit no offset (v,).
    """

    seen: list[StoredObservations]
    shift: list[float]
    steps: dict[int, FrameDrops]
    repeated_frames: list[int]
    unmatched_frames: list[int]

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
        notes += [
            TrackWarning(
                f"{name}: {count} frames do not fit those of {names[0]} at any similar offset, and"
                " were left out. Check that no camera was moved and that its times do not jump.",
                "frames-unmatched",
            )
            for name, count in zip(names, self.unmatched_frames, strict=True)
            if count > MAX_UNNOTED_FRAMES
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
        for c, steps in self.steps.items():
            changes = np.diff(steps.offsets)
            where = ", ".join(
                f"{1e3 * b:+.0f} ms at {t:.2f} s"
                for t, b in list(zip(steps.change_times, changes, strict=True))[:5]
            )
            lost = sorted({names[c] if b > 0 else names[0] for b in changes})
            notes.append(
                TrackWarning(
                    f"{names[c]}: its offset from {names[0]} changed {len(changes)} times ({where}"
                    f"{', ...' if len(changes) > 5 else ''}), because frames of"
                    f" {' and '.join(lost)} are missing without a gap in the time stamps. Times"
                    " were corrected by how the tags move, and uncertain frames were left out.",
                    "frames-lost",
                )
            )
        return notes


def sync_cameras(
    rig: Rig,
    seen: Sequence[StoredObservations],
    *,
    offsets_given: bool,
    excluded: int | None = None,
) -> CameraSync:
    """Synchronize cameras with the first one.

    Args:
        rig: The cameras.
        seen: Observations of each camera.
        offsets_given: Whether the offsets were given, so they stay.
        excluded: A camera that is left out. If it is the first, the second one's clock is used.
    """
    if excluded is not None:
        included = [c for c in range(len(seen)) if c != excluded]
        partial = sync_cameras(
            Rig(tuple(rig.cameras[c] for c in included)),
            [seen[c] for c in included],
            offsets_given=offsets_given,
        )
        removed = seen[excluded]
        synchronized = list(partial.seen)
        synchronized.insert(excluded, removed.without(np.ones(len(removed.time), bool)))
        shift, frozen, unfit = (
            list(partial.shift),
            list(partial.repeated_frames),
            list(partial.unmatched_frames),
        )
        shift.insert(excluded, 0.0)
        frozen.insert(excluded, 0)
        unfit.insert(excluded, 0)
        return CameraSync(
            synchronized,
            shift,
            {included[c]: observations for c, observations in partial.steps.items()},
            frozen,
            unfit,
        )
    seen, frozen = _remove_repeats(seen)
    shift, synchronized, steps, unfit = [0.0], [seen[0]], {}, [0] * len(seen)
    for c, observations in enumerate(seen[1:], 1):
        pair = [rig.cameras[0], rig.cameras[c]]
        offset = (
            None if offsets_given else find_offset(pair, seen[0], observations, MAX_CLOCK_OFFSET_S)
        )
        start_offset = 0.0
        if not offsets_given and (offset is None or offset.after >= MAX_RESIDUAL_PX):
            start_offset = _start_offset(pair, seen[0], observations)
            observations = replace(observations, time=observations.time + start_offset)
        drops = find_frame_drops(pair, seen[0], observations, MAX_CLOCK_OFFSET_S)
        if drops is not None and not len(drops.change_times):
            fits = np.isfinite(drops.time)
            unfit[c] = int((~fits).sum())
            observations = observations.only(fits)
            offset = None
        elif drops is not None:
            steps[c] = drops
            shift.append(start_offset + float(np.median(drops.offsets)))
            is_known = np.isfinite(drops.time)
            synchronized.append(replace(observations, time=drops.time).only(is_known))
            continue
        refined = offset
        if not offsets_given and (offset is None or start_offset):
            refined = find_offset(pair, seen[0], observations, MAX_CLOCK_OFFSET_S)
        is_late = (
            refined is not None
            and abs(refined.value) > max(MIN_CORRECTION_S, 4 * refined.sigma)
            and refined.after < MAX_RESIDUAL_RATIO * refined.before
            and refined.after < MAX_RESIDUAL_PX
        )
        correction = refined.value if refined is not None and is_late else 0.0
        shift.append(start_offset + correction)
        synchronized.append(replace(observations, time=observations.time + correction))
    return CameraSync(synchronized, shift, steps, frozen, unfit)


def _start_offset(pair: list[Camera], first: ObservationSource, second: ObservationSource) -> float:
    """Return by how much the second video started later, s, if more than clocks differ."""
    offset = find_offset(pair, first, second, MAX_START_OFFSET_S)
    if (
        offset is None
        or abs(offset.value) <= MAX_CLOCK_OFFSET_S - 0.05
        or offset.after > MAX_RESIDUAL_PX
    ):
        return 0.0
    return offset.value if offset.after < MAX_RESIDUAL_RATIO * offset.before else 0.0


def views_at_frames(seen: Sequence[ObservationSource], frames: Int) -> tuple[Float, Float]:
    """Return the views of all cameras at the times of frames (k,) of the first one.

    Returns:
        Corners (k, m, v, 4, 2), px, and covariances (k, m, v, 5, 2, 2), px^2.
    """
    first = seen[0].part(frames)
    parts = [(first.corners, first.covariance), *(interpolate(s, first.time) for s in seen[1:])]
    return np.stack([p[0] for p in parts], axis=2), np.stack([p[1] for p in parts], axis=2)


def views_of_tags(seen: Sequence[ObservationSource], rows: Int) -> tuple[Float, Float]:
    """Return the views of single tags by all cameras.

    Args:
        seen: Observations of each camera.
        rows: Frames of the first camera and tags (n, 2).

    Returns:
        Corners (n, v, 4, 2), px, and covariances (n, v, 5, 2, 2), px^2.
    """
    frames, place = np.unique(rows[:, 0], return_inverse=True)
    corners, covariance = views_at_frames(seen, frames)
    return corners[place, rows[:, 1]], covariance[place, rows[:, 1]]


def _remove_repeats(
    seen: Sequence[StoredObservations],
) -> tuple[list[StoredObservations], list[int]]:
    """Remove frames that repeat the previous image although tags move.

    Motion shows in the camera's next image, or in another camera.
    """
    out, counts = [], []
    for c, observations in enumerate(seen):
        is_wrong = np.zeros(len(observations.time), bool)
        for start, end in _repeated_runs(observations):
            corners = observations.part(
                np.arange(start, min(end + 1, len(observations.time)))[[0, -1]]
            ).corners
            after = corners[1] if end < len(observations.time) else np.full_like(corners[0], np.nan)
            if _has_moved(corners[0], after) or any(
                _tags_move(other, observations.time[start], observations.time[end - 1])
                for k, other in enumerate(seen)
                if k != c
            ):
                is_wrong[start + 1 : end] = True
        counts.append(int(is_wrong.sum()))
        # Others are interpolated; the first determines the frames.
        out.append(observations.only(~is_wrong) if c else observations.without(is_wrong))
    return out, counts


def _repeated_runs(observations: ObservationSource) -> list[tuple[int, int]]:
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


def _tags_move(observations: ObservationSource, start: float, end: float) -> bool:
    """Return whether tags move in a camera between two times, s."""
    rows = np.flatnonzero((observations.time >= start) & (observations.time <= end))
    if len(rows) < 2:
        return False
    first = observations.part(rows[:1]).corners
    parts = (rows[1:][k] for k in frame_blocks(len(rows) - 1, len(observations.ids)))
    return any(bool(_has_moved(observations.part(part).corners, first)) for part in parts)
