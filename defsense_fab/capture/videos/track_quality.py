"""Measure the quality of tracks, and the size of the tags.

Tags that were printed with "fit to page" are some per cent smaller. Positions by several cameras do
not depend on the size; positions by one camera are too far or too near by the same percentage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.markers import Tracks
from .camera_sync import Count, TrackWarning
from .located_tags import LocatedTags
from .video_detection import VideoDetections

MIN_SIZE_ERROR = 0.01  # relative; edges that look thinner or thicker explain less
MIN_SIZE_SIGMAS = 2.0
MIN_SIDES = 3  # of a tag, from which its size is measured
SIGMA_PER_MAD = 1.4826  # median absolute deviation of a normal distribution
MAX_LENGTH_DIFFERENCE_S = 0.25  # of the videos, without a warning
REPEATED_TAGS_ACTION = "Print each number once, or cover reflections"
MEDIAN_SIGMA_RATIO = 1.2533  # relative to the mean of many values


@dataclass(frozen=True)
class MeasuredSize:
    """Measured side of the tags.

    Attributes:
        side: Median side, mm.
        sigma: Its standard deviation, mm.
        stated: Stated side, mm.
    """

    side: float
    sigma: float
    stated: float

    @property
    def warning(self) -> TrackWarning | None:
        """Warning if the stated size is wrong."""
        error = abs(self.side - self.stated)
        if error <= max(MIN_SIZE_ERROR * self.stated, MIN_SIZE_SIGMAS * self.sigma):
            return None
        ratio = self.side / self.stated
        return TrackWarning(
            f"The tags measure {self.side:.2f} mm, but {self.stated:g} mm is stated (standard"
            f" deviation {self.sigma:.2g} mm). They were printed at {ratio:.1%}, or the"
            " calibration's lengths are wrong by as much. Measure the black square of a tag. If it"
            f" is {self.side:.2f} mm, print tags at 100 % or state this size, because positions by"
            f" one camera are {abs(1 / ratio - 1):.1%} too {'far' if ratio < 1 else 'near'}. If it"
            f" is {self.stated:g} mm, all positions are wrong by as much: measure the squares of"
            " the calibration's board, and calibrate again.",
            "tag-size-wrong",
        )


def measure_size(sides: Float, stated: float) -> MeasuredSize | None:
    """Measure the side of the tags.

    Errors that tags share in one frame, or that a tag has in all frames, do not average out. The
    standard deviation follows from how much tags and frames differ among each other.

    Args:
        sides: Sides of the tags as located by several cameras (t, m), mm, NaN where not located.
        stated: Stated side, mm.

    Returns:
        The measured side; None with too few values.
    """
    columns = [s[np.isfinite(s)] for s in sides.T]
    columns = [s for s in columns if len(s) >= MIN_SIDES]
    if not columns:
        return None
    tag_sides = np.array([np.median(s) for s in columns])
    frame_sigmas = np.array([_robust_sigma(s) for s in columns])
    # With too few tags to measure by how much they differ, as much as frames do.
    tag_sigma = (
        _robust_sigma(tag_sides) if len(tag_sides) >= MIN_SIDES else float(np.median(frame_sigmas))
    )
    frame_sigma = float(np.median(frame_sigmas / np.sqrt([len(s) for s in columns])))
    sigma = MEDIAN_SIGMA_RATIO * float(np.hypot(tag_sigma / np.sqrt(len(tag_sides)), frame_sigma))
    return MeasuredSize(float(np.median(tag_sides)), sigma, float(stated))


def _robust_sigma(values: Float) -> float:
    """Return the standard deviation by the median absolute deviation."""
    return SIGMA_PER_MAD * float(np.median(np.abs(values - np.median(values))))


@dataclass(frozen=True)
class WatchedVideo:
    """A video whose tags were detected.

    Attributes:
        name: Name of the video.
        detections: Its detections.
        repeated_ids: Numbers of tags that it shows twice in a frame.
    """

    name: str
    detections: VideoDetections
    repeated_ids: Int

    @property
    def record(self) -> dict[str, Any]:
        """Its values in `quality.json`."""
        timing = self.detections.timing
        return {
            "name": self.name,
            "frames": len(self.detections.time),
            "expected": self.detections.expected,
            "missing": timing.missing,
            "repeated": timing.repeated,
            "period": timing.period,
            "tags_per_frame": float(self.detections.tags.count.mean()),
        }

    @property
    def timing_warnings(self) -> list[TrackWarning]:
        """Warnings about its frames."""
        timing, frames = self.detections.timing, len(self.detections.time)
        warnings = []
        if self.detections.expected > frames + 1:
            warnings.append(
                TrackWarning(
                    f"{self.name}: ends early, after {frames} of {self.detections.expected} frames."
                    " Check that it is not damaged.",
                    "video-ends-early",
                )
            )
        if timing.missing or timing.repeated:
            warnings.append(
                TrackWarning(
                    f"{self.name}: {timing.missing} frames are missing and {timing.repeated}"
                    " repeated, by its time stamps.",
                    "frames-missing",
                )
            )
        return warnings

    @property
    def tag_warnings(self) -> list[TrackWarning]:
        """Warnings about the tags it shows."""
        warnings = []
        if not self.detections.tags.count.any():
            warnings.append(
                TrackWarning(
                    f"{self.name}: shows no tag in any frame. Check that it is the right video.",
                    "no-tag-in-video",
                )
            )
        if self.repeated_tags:
            text = f"{self.name}: {self.repeated_tags}. {REPEATED_TAGS_ACTION}."
            warnings.append(TrackWarning(text, "tags-repeated"))
        return warnings

    @property
    def repeated_tags(self) -> str:
        """Which tags it shows twice at once; empty for none."""
        if not len(self.repeated_ids):
            return ""
        numbers = ", ".join(map(str, self.repeated_ids.tolist()))
        return f"shows tags {numbers} twice at once"


def measure_quality(
    videos: Sequence[WatchedVideo],
    located: LocatedTags,
    is_kept: Bool,
    tracks: Tracks,
    cameras: Count,
    size: float,
) -> dict[str, Any]:
    """Measure the quality of tracks.

    Args:
        videos: The videos.
        located: Located tags.
        is_kept: Positions that were kept (t, m).
        tracks: The tracks.
        cameras: Number of cameras of each position (t, m).
        size: Stated side of the tags, mm.

    Returns:
        Plain values and warnings for `quality.json`.
    """
    by_several, by_one = cameras >= 2, cameras == 1
    sigma = np.linalg.norm(tracks.sigma, axis=-1)
    measured = measure_size(np.where(is_kept, located.sides, np.nan), size)
    warnings = [warning for video in videos for warning in video.timing_warnings]
    warnings += _view_warnings(videos, tracks.ids, by_several, by_one)
    if measured is not None and measured.warning is not None:
        warnings.append(measured.warning)
    with np.errstate(all="ignore"):
        return {
            "frames": len(tracks.time),
            "markers": len(tracks.ids),
            "seen": float(tracks.visible.mean()),
            "by_several": float(by_several.mean()),
            "by_one": float(by_one.mean()),
            "residual": _median(located.miss[is_kept & (located.cameras >= 2)]),
            "sigma_several": _median(sigma[by_several]),
            "sigma_one": _median(sigma[by_one]),
            "size": None if measured is None else measured.side,
            "size_sigma": None if measured is None else measured.sigma,
            "tag_size": size,
            "videos": [video.record for video in videos],
            "warnings": warnings,
        }


def _view_warnings(
    videos: Sequence[WatchedVideo], ids: Int, by_several: Bool, by_one: Bool
) -> list[TrackWarning]:
    """Return warnings about the number of cameras that see the tags."""
    warnings = []
    spans = [video.detections.time[-1] - video.detections.time[0] for video in videos]
    if len(spans) > 1 and max(spans) - min(spans) > MAX_LENGTH_DIFFERENCE_S:
        lengths = ", ".join(f"{s:.1f}" for s in spans)
        warnings.append(
            TrackWarning(
                f"The videos have different lengths ({lengths} s), so the end is by fewer cameras.",
                "lengths-differ",
            )
        )
    share = "Most" if by_several.any() else "All" if len(videos) > 1 else None
    if share and by_one.sum() > by_several.sum():
        warnings.append(
            TrackWarning(
                f"{share} positions are by one camera alone, so their depth is uncertain.",
                "depth-uncertain",
            )
        )
    warnings += [warning for video in videos for warning in video.tag_warnings]
    single_view = sorted(set(ids.tolist()) - set(ids[by_several.any(axis=0)].tolist()))
    if single_view and len(videos) > 1:
        warnings.append(
            TrackWarning(
                f"Tags {', '.join(map(str, single_view))} were never seen by two cameras at once.",
                "tags-by-one-camera",
            )
        )
    return warnings


def _median(values: Float) -> float | None:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else None
