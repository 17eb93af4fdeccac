"""Make a dataset of two files: signals, and tracks of any motion-capture system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.clocks.synchronization import synchronize_by_motion
from ...capture.files.absent_markers import list_some
from ...capture.files.formats import read_track_file
from ...capture.files.length_units import LengthUnit
from ...capture.files.track_file import TrackFile
from ...capture.sessions.rest_frame import align_with_rest
from ...capture.sessions.signals import marker_distances
from ...capture.tracking.rest_pose import MAX_DISTANCE_MM
from ...core.arrays import Bool, Float
from ...core.errors import CaptureError, TrainingError
from ...core.markers import Markers, Tracks
from ..data.dataset import Dataset, Recording
from ..options import ClockShift
from .series import Series, increasing_times, read_series

_INITIAL_REST_S = 3.0  # at the start, in which the device is taken to be at rest
_MIN_ANCHOR_MARKERS = 3  # fixed markers that determine the device's frame
_MIN_INCREASING_SHARE = 0.99  # of the samples
_MAX_EXTRA_SHARE = 0.1  # of the samples' time after the end of the tracks, without a note
_MAX_REST_RMS_MM = 1.0  # root mean square distance of the markers from rest, at rest
_MIN_REST_S = 0.5  # at the rest positions, for R0
_MIN_REST_MARKERS = 3  # visible markers of a frame at rest


@dataclass(frozen=True)
class RecordingInfo:
    """Facts that files of other systems do not state.

    Attributes:
        device: Name of the device; None to take that of the markers.
        layout: Hash of the layout of its cords; empty if unknown.
        unit: Name of the built device; empty for the device's name.
        markers: The device's markers; None to take their rest positions from the start of the
            tracks, which then must be in the device's rest frame.
        offset: Seconds such that tracks' time = signals' time + offset; "auto" to find it from the
            relation of motion and signals.
        tracks_unit: Unit of the positions in a file of tracks that does not state it.
        fallback_device: Name of the device if neither `device` nor `markers` is given.
    """

    device: str | None = None
    layout: str = ""
    unit: str = ""
    markers: Markers | None = None
    offset: ClockShift = 0.0
    tracks_unit: LengthUnit | None = None
    fallback_device: str = ""

    def device_name(self, source: str) -> str:
        """Return the name of the device, by default that of the tracks' file without suffix."""
        if self.device:
            return self.device
        if self.markers is not None:
            return self.markers.device
        return self.fallback_device or Path(source).stem


def pair_dataset(signals: Path, tracks: Path, info: RecordingInfo | None = None) -> Dataset:
    """Make a dataset of a table of signals and a file of tracks.

    With markers, tracks in another frame than the device's are aligned to its rest pose.

    Args:
        signals: The table; see `series.read_series`.
        tracks: The tracks (.csv, .npz, .parquet, .c3d, .trc), whose markers are named by their
            numbers.
        info: Facts that the files do not state.

    Returns:
        The dataset, with one recording.

    Raises:
        TrainingError: If the files do not match each other or the markers.
        CaptureError: If the tracks cannot be read.
    """
    info = info or RecordingInfo()
    series, file = read_series(signals), read_track_file(tracks, info.tracks_unit)
    if info.markers is not None:
        require_numbers(file, info.markers, str(tracks))
    notes = [f"{tracks.name}: {note}" for note in file.notes]
    return dataset_of_series(series, file.tracks, str(tracks), info, notes)


def require_numbers(file: TrackFile, markers: Markers, source: str) -> None:
    """Check that the labels of a file have the markers' numbers.

    Args:
        file: The file as read.
        markers: The device's markers.
        source: Name of the file.

    Raises:
        TrainingError: If they have none, so that markers were numbered in the file's order.
    """
    if file.is_in_file_order:
        raise TrainingError(
            f"its labels do not number the markers: {list_some(file.labels)}",
            code="markers-differ",
            where=source,
            action="Name the markers by the device's numbers (tag_1, tag_2, ...)",
            found=file.labels,
            expected=tuple(markers.ids.tolist()),
        )


def dataset_of_series(
    series: Series,
    tracks: Tracks,
    source: str,
    info: RecordingInfo,
    file_notes: Sequence[str] = (),
) -> Dataset:
    """Make a dataset of signals and tracks.

    Args:
        series: The signals.
        tracks: The tracks.
        source: Name of the tracks' file.
        info: Facts that the files do not state.
        file_notes: What the readers of the files left out or assumed.

    Returns:
        The dataset, with one recording.

    Raises:
        TrainingError: If signals and tracks do not match each other or the markers.
    """
    if len(tracks.time) < 2 or not tracks.visible.any():
        raise TrainingError(
            f"no marker is visible in its {len(tracks.time)} frames",
            code="no-markers",
            where=source,
            frames=len(tracks.time),
        )
    series = _select_increasing(series)
    time, error, offset_text = _synchronize(series, tracks, source, info.offset)
    require_common_time(series.source, time, source, tracks.time)
    start = max(float(tracks.time[0]), float(time[0]))
    is_initial = np.asarray(tracks.time <= start + _INITIAL_REST_S)
    tracks, rest_points, rest_notes = _find_rest(tracks, source, is_initial, info)
    notes = [*series.notes, *file_notes, *rest_notes]
    extra = float(time[-1] - tracks.time[-1])
    if extra > max(_MAX_EXTRA_SHARE * float(np.ptp(time)), _INITIAL_REST_S):
        notes.append(
            f"the tracks end {extra:.0f} s before the signals: check whether {source} is truncated"
        )
    rest, note = _find_resistances(series, time, tracks, rest_points, is_initial, info)
    notes.append(note)
    ohm = series.ohm if series.ohm is not None else rest * (1 + _changes(series))
    name = info.device_name(source)
    recording = Recording(
        name=series.source,
        session=series.source,
        unit=info.unit or name,
        sample_time=time,
        ohm=ohm,
        rest=rest,
        time=tracks.time,
        points=tracks.points,
        sigma=tracks.sigma,
        sync_error=error,
    )
    session: dict[str, Any] = {
        "folder": series.source,
        "tracks": source,
        "device": name,
        "unit": info.unit,
        "layout": info.layout,
        "offset": offset_text,
        "offset_by": "motion" if info.offset == "auto" else "user",
        "notes": notes,
    }
    return Dataset(
        name,
        info.layout,
        series.channels,
        tracks.ids,
        rest_points,
        (recording,),
        {"sessions": [session]},
    )


def require_common_time(signals: str, time: Float, targets: str, frames: Float) -> None:
    """Raise an error if samples and targets have no time in common.

    Args:
        signals: Name of the signals' file.
        time: Times of the samples, shape (n,), s, on the targets' clock.
        targets: Name of the targets' file.
        frames: Times of the targets, shape (t,), s.

    Raises:
        TrainingError: If they do not overlap.
    """
    if time[-1] < frames[0] or time[0] > frames[-1]:
        raise TrainingError(
            f"{signals} and {targets} have no time in common ({time[0]:.1f} to {time[-1]:.1f} s,"
            f" {frames[0]:.1f} to {frames[-1]:.1f} s)",
            code="no-common-time",
            action="Give the offset between them, or let it be found (auto)",
            signals=(float(time[0]), float(time[-1])),
            tracks=(float(frames[0]), float(frames[-1])),
        )


def _align_to_design(
    tracks: Tracks, markers: Markers, is_initial: Bool, source: str
) -> tuple[Tracks, list[str]]:
    """Transform tracks into the device's rest frame.

    Tracks whose anchor markers are already at their positions stay as they are. Others are aligned
    to the anchor frame by frame (Kabsch). The device is at rest in the frames `is_initial` (t,).
    Returns the tracks of the device's markers, and notes on what was done.
    """
    named = _select_markers(tracks, markers, source)
    distance, subject = _rest_distance(named.points, markers, is_initial)
    if distance <= MAX_DISTANCE_MM:
        return named, [f"in the device's frame as given: {subject} {distance:.2f} mm off"]
    corners = np.full((len(tracks.time), int(markers.anchor.sum()), 4, 3), np.nan, np.float32)
    try:
        alignment = align_with_rest(markers, named, corners, is_initial, "auto")
    except CaptureError as error:
        raise TrainingError(
            f"is not in the device's frame ({subject} {distance:.1f} mm off), and cannot be aligned"
            f" to its rest pose: {error}",
            code="not-in-device-frame",
            where=source,
            action="Give tracks in mm that start at rest",
            distance_mm=distance,
        ) from None
    aligned = alignment.aligned.points
    remaining, subject = _rest_distance(aligned, markers, is_initial)
    if not remaining <= MAX_DISTANCE_MM:
        raise TrainingError(
            f"is not in the device's frame, and its markers are not at the positions of"
            f" markers.json: {subject} {remaining:.1f} mm off",
            code="markers-misplaced",
            where=source,
            action=(
                "Check the markers' numbers, the tracks' unit, and that the device rests at the"
                " start"
            ),
            distance_mm=remaining,
        )
    note = (
        f"aligned by {alignment.by}, from {distance:.1f} mm off: {subject} {remaining:.2f} mm off"
    )
    sigma = np.where(np.isfinite(named.sigma), alignment.aligned.sigma, np.nan)
    moved = Tracks(tracks.time, markers.ids, aligned, sigma, tracks.frame)
    return moved, [note, *alignment.warnings]


def _select_markers(tracks: Tracks, markers: Markers, source: str) -> Tracks:
    """Return the tracks with the device's markers, in their order."""
    is_tracked = np.isin(markers.ids, tracks.ids)
    if is_tracked.sum() < _MIN_ANCHOR_MARKERS:
        track_ids, device_ids = (", ".join(map(str, i.tolist())) for i in (tracks.ids, markers.ids))
        raise TrainingError(
            f"its markers are {track_ids}, but the device's are {device_ids}",
            code="markers-differ",
            where=source,
            action="Name the markers by the device's numbers (tag_1, tag_2, ...)",
            found=tuple(tracks.ids.tolist()),
            expected=tuple(markers.ids.tolist()),
        )
    points, sigma = np.full((2, len(tracks.time), len(markers.ids), 3), np.nan)
    index = [tracks.ids.tolist().index(i) for i in markers.ids[is_tracked].tolist()]
    points[:, is_tracked], sigma[:, is_tracked] = tracks.points[:, index], tracks.sigma[:, index]
    return Tracks(tracks.time, markers.ids, points, sigma, tracks.frame)


def _rest_distance(points: Float, markers: Markers, is_initial: Bool) -> tuple[float, str]:
    """Return the median distance in mm of markers from their rest positions, and which they are.

    They are the anchor's markers at all times, or all markers at rest if those are not visible.
    """
    distance = np.linalg.norm(points - markers.centers, axis=2)
    is_used, subject = markers.anchor, "the anchor's markers are"
    if np.isfinite(distance[:, is_used]).any(axis=0).sum() < _MIN_ANCHOR_MARKERS:
        distance, is_used = distance[is_initial], np.ones(len(markers.ids), bool)
        subject = "markers at rest are"
    known = distance[:, is_used]
    known = known[np.isfinite(known)]
    return (float(np.median(known)) if len(known) else np.inf), subject


def _select_increasing(series: Series) -> Series:
    """Return the samples whose times increase; raise an error if they are too few."""
    is_kept = increasing_times(series.time)
    if is_kept.sum() < _MIN_INCREASING_SHARE * len(is_kept):
        first = int(np.argmin(is_kept))
        raise TrainingError(
            f"{len(is_kept) - int(is_kept.sum())} of {len(is_kept)} samples are not later than"
            f" those before; the first is sample {first + 1}, at {series.time[first]:.3f} s",
            code="times-not-increasing",
            where=series.source,
            action="If these are several takes, give each one separately",
            series="samples",
            index=first,
        )

    def select(values: Float | None) -> Float | None:
        return None if values is None else values[is_kept]

    return replace(
        series, time=series.time[is_kept], ohm=select(series.ohm), change=select(series.change)
    )


def _find_rest(
    tracks: Tracks, source: str, is_initial: Bool, info: RecordingInfo
) -> tuple[Tracks, Float, list[str]]:
    """Return tracks in the rest frame, marker positions at rest (m, 3) mm, and notes."""
    if info.markers is not None:
        tracks, notes = _align_to_design(tracks, info.markers, is_initial, source)
        return tracks, info.markers.centers, notes
    rest_points = _median_positions(tracks.points, is_initial)
    notes = [
        f"rest positions of the markers are those of the first {_INITIAL_REST_S:g} s; the tracks"
        " are taken to be in the device's frame"
    ]
    movement = _movement(tracks.points, rest_points, is_initial)
    if movement > _MAX_REST_RMS_MM:
        notes.append(
            f"markers move by {movement:.0f} mm in the first {_INITIAL_REST_S:g} s, which are taken"
            " for the rest, so rest positions and R0 are wrong: start with a rest, or give"
            " markers.json"
        )
    return tracks, rest_points, notes


def _find_resistances(
    series: Series,
    time: Float,
    tracks: Tracks,
    rest_points: Float,
    is_initial: Bool,
    info: RecordingInfo,
) -> tuple[Float, str]:
    """Return the resistances at rest (c,) ohm, and a note on their origin."""
    is_at_rest, period = is_initial, f"of the first {_INITIAL_REST_S:g} s"
    if info.markers is not None:
        is_still = _is_still(tracks, rest_points)
        duration = float(is_still.mean()) * float(np.ptp(tracks.time))
        if duration > _MIN_REST_S:
            is_at_rest = is_still
            period = f"of the {duration:.1f} s in which the markers are at rest"
    rest, origin = series.rest(_nearest_flag(time, tracks.time, is_at_rest))
    return rest, f"R0: {origin}" + (f" ({period})" if origin.endswith("at rest") else "")


def _changes(series: Series) -> Float:
    assert series.change is not None
    return series.change


def _synchronize(
    series: Series, tracks: Tracks, source: str, offset: ClockShift
) -> tuple[Float, float | None, str]:
    """Return sample times (n,) s on the tracks' clock, their standard error, and a description."""
    if offset != "auto":
        return series.time + float(offset), None, f"{float(offset):g} s, as given"
    values = series.ohm if series.ohm is not None else _changes(series)
    try:
        sync = synchronize_by_motion(tracks.time, marker_distances(tracks), series.time, values)
    except CaptureError as error:
        raise TrainingError(
            f"no offset between {series.source} and {source} is found by motion ({error})",
            code="offset-not-found",
            action="Give the offset",
        ) from None
    description = f"{sync.offset:.4f} s and a drift of {sync.drift:.2e}, by motion"
    return sync.to_camera(series.time), sync.error, description


def _median_positions(points: Float, which: Bool) -> Float:
    """Return median positions (m, 3) mm in some frames, or in all for markers hidden in those."""
    positions = np.full(points.shape[1:], np.nan)
    for part in (points[which], points):
        for k in np.flatnonzero(np.isnan(positions[:, 0])):
            visible = part[np.isfinite(part[:, k, 0]), k]
            if len(visible):
                positions[k] = np.median(visible, axis=0)
    return positions


def _movement(points: Float, rest_points: Float, which: Bool) -> float:
    """Return the root mean square distance in mm of markers from rest in some frames."""
    squares = ((points[which] - rest_points) ** 2).sum(axis=2)
    known = squares[np.isfinite(squares)]
    return float(np.sqrt(known.mean())) if len(known) else 0.0


def _is_still(tracks: Tracks, rest_points: Float) -> Bool:
    """Return the frames (t,) with at least three visible markers, all at their rest positions."""
    with np.errstate(all="ignore"):
        distance = np.linalg.norm(tracks.points - rest_points, axis=2)
        visible = np.isfinite(distance)
        rms = np.sqrt(np.where(visible, distance**2, 0).sum(axis=1) / visible.sum(axis=1))
    return np.asarray((visible.sum(axis=1) >= _MIN_REST_MARKERS) & (rms < _MAX_REST_RMS_MM))


def _nearest_flag(sample_time: Float, time: Float, flags: Bool) -> Bool:
    """Return the flag (t,) of the nearest frame for each sample (n,); False outside the frames."""
    k = np.clip(np.searchsorted(time, sample_time), 1, len(time) - 1)
    k -= sample_time - time[k - 1] < time[k] - sample_time
    is_inside = (sample_time >= time[0]) & (sample_time <= time[-1])
    return np.asarray(flags[k] & is_inside)
