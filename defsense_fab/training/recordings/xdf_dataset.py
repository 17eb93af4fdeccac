"""Make datasets of XDF files, in which programs record streams of the Lab Streaming Layer."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...capture.files.length_units import mm_per_unit
from ...capture.files.track_file import TrackFile, labeled_tracks
from ...core.arrays import Int
from ...core.errors import TrainingError
from ..data.dataset import Dataset
from .pair_dataset import RecordingInfo, dataset_of_series, require_numbers
from .series import OHM, Series, increasing_times, make_series
from .xdf_streams import XdfStream, join_restarted, read_streams

_COORDINATE = re.compile(r"(.*?)[_. -]([xyz])", re.IGNORECASE)
_END_NUMBER = re.compile(r"[0-9]{1,15}$")
_OHM_PER_UNIT = {"ohm": 1.0, "ohms": 1.0, "Ω": 1.0, "kohm": 1000.0, "kohms": 1000.0, "kΩ": 1000.0}
_NO_UNIT = ("", "1", "none", "normalized", "relative")


def xdf_dataset(
    path: Path,
    info: RecordingInfo | None = None,
    *,
    signals: str | None = None,
    tracks: str | None = None,
) -> Dataset:
    """Make a dataset of an .xdf or .xdfz file.

    The file needs a stream of signals (or resistances: with the unit ohm, or labels that end in
    `_ohm`), and a stream of tracks (labels `tag_1_x`, `tag_1_y`, ... or `1_x`; in mm, or the unit
    stated). Clocks are those of the Lab Streaming Layer. A file that is cut off or damaged is read
    around the damage, and streams of a sender that was restarted are joined; both are noted.

    Args:
        path: The file.
        info: Facts that the file does not state.
        signals: Stream of signals: its name, its type, its uid, or its name and number, such as
            `Board#3`; None to detect it by its labels.
        tracks: Stream of tracks, stated in the same way; None to detect it by its labels.

    Returns:
        The dataset, with one recording.

    Raises:
        TrainingError: If the file cannot be read or has no such streams; those found are stated.
        CaptureError: If two markers of the tracks are the same tag.
    """
    streams, damage = read_streams(path)
    if not streams and damage:
        raise TrainingError(
            f"has no stream of numbers: {'; '.join(damage)}",
            code="file-damaged",
            where=path,
            action="Copy it again, or record again",
        )
    joined, _ = join_restarted(streams)
    with_markers = [s for s in joined if _marker_columns(s)]
    marker_stream, notes = _choose(path, streams, tracks, "markers", with_markers)
    if not _marker_columns(marker_stream):
        raise TrainingError(
            f"the stream {marker_stream.description} has no markers",
            code="no-markers",
            where=path,
            action="Label its channels tag_1_x, tag_1_y, tag_1_z, ...",
            stream=marker_stream.name,
        )
    others = [
        s
        for s in joined
        if s.number != marker_stream.number and any(s.labels) and not _marker_columns(s)
    ]
    signal_stream, more = _choose(path, streams, signals, "signals", others)
    info = info or RecordingInfo()
    if info.offset != "auto":
        _require_clocks(path, (signal_stream, marker_stream), damage)
    start = min(float(s.time[0]) for s in (marker_stream, signal_stream))
    series = _to_series(path, signal_stream, start)
    file, source = _to_tracks(path, marker_stream, start), f"{path}, {marker_stream.name}"
    if info.markers is not None:
        require_numbers(file, info.markers, source)
    return dataset_of_series(
        series,
        file.tracks,
        source,
        info,
        [*damage, *notes, *more, *file.notes],
    )


def _require_clocks(path: Path, streams: Sequence[XdfStream], damage: Sequence[str]) -> None:
    """Raise an error if the relation of the streams' clocks was lost."""
    lost = [stream.name for stream in streams if stream.is_clock_lost]
    if lost:
        raise TrainingError(
            f"the clock of the stream {lost[0]!r} is unknown: {'; '.join(damage)}",
            code="clock-unknown",
            where=path,
            action="Let the offset between signals and tracks be found (offset auto)",
            stream=lost[0],
        )


def _marker_columns(stream: XdfStream) -> dict[str, dict[str, int]]:
    """Return the columns of x, y and z by the markers' labels; empty if none ends in a number."""
    columns: dict[str, dict[str, int]] = {}
    for k, label in enumerate(stream.labels):
        if match := _COORDINATE.fullmatch(label):
            columns.setdefault(match[1], {}).setdefault(match[2].lower(), k)
    markers = {label: axes for label, axes in columns.items() if len(axes) == len("xyz")}
    return markers if any(map(_END_NUMBER.search, markers)) else {}


def _choose(
    path: Path,
    streams: Sequence[XdfStream],
    requested: str | None,
    content: str,
    candidates: list[XdfStream],
) -> tuple[XdfStream, list[str]]:
    """Return the requested stream or the only candidate, and notes on streams that were joined."""
    if requested is not None:
        candidates = _find_streams(streams, requested)
    if len(candidates) == 1:
        parts = [s for s in streams if s.source == candidates[0].source]
        is_part = any(s is candidates[0] for s in streams)
        return candidates[0], [] if is_part else join_restarted(parts)[1]
    if not candidates:
        problem = f"has no stream {requested!r}" if requested else f"has no stream of {content}"
        labels = "tag_1_x, tag_1_y, tag_1_z, ..." if content == "markers" else "by the cords' names"
        action = "Name one of these" if requested else f"Label its channels {labels}"
    else:
        subject = f"are named {requested!r}" if requested else f"may be the {content}"
        problem = f"has {len(candidates)} streams that {subject}"
        action = f"Name the stream of {content} with its number, such as {candidates[0].label}"
    shown = candidates or streams
    descriptions = "; ".join(s.description for s in shown) or "none with numbers"
    raise TrainingError(
        f"{problem}; its streams are: {descriptions}",
        code="stream-not-found" if not candidates else "stream-ambiguous",
        where=path,
        action=action,
        content=content,
        streams=tuple(s.name for s in streams),
    )


def _find_streams(streams: Sequence[XdfStream], requested: str) -> list[XdfStream]:
    """Return the streams of a name, type, uid, or name and number; joined if they can be."""
    for named in (
        [s for s in streams if s.label == requested or (s.uid and s.uid == requested)],
        [s for s in streams if s.name == requested],
        [s for s in streams if s.kind == requested],
    ):
        if named:
            return join_restarted(named)[0]
    return []


def _to_series(path: Path, stream: XdfStream, start: float) -> Series:
    """Return signals with times in s from `start`."""
    names, factors = [], []
    for label, unit in zip(stream.labels, stream.units, strict=True):
        if unit in _OHM_PER_UNIT:
            names.append(label if label.endswith(OHM) else label + OHM)
            factors.append(_OHM_PER_UNIT[unit])
        elif unit.lower() in _NO_UNIT or (unit == "%" and not label.endswith(OHM)):
            is_resistance = "resist" in stream.kind.lower() and not label.endswith(OHM)
            names.append(label + OHM if is_resistance and unit == "" else label)
            factors.append(0.01 if unit == "%" else 1.0)
        else:
            raise TrainingError(
                f"{label} of the stream {stream.name!r} has the unit {unit!r}",
                code="unknown-unit",
                where=path,
                action="Give signals without a unit, or resistances in ohm or kohm",
                channel=label,
                unit=unit,
            )
    has_blank = not all(stream.labels)
    if has_blank or len(set(names)) < len(names):
        raise TrainingError(
            f"the channels of the stream {stream.description} lack labels, or labels repeat",
            code="labels-invalid",
            where=path,
            action="Label the channels by the cords' names",
            stream=stream.name,
        )
    values = stream.values * np.array(factors)
    return make_series(f"{path}, {stream.name}", names, stream.time - start, values)


def _to_tracks(path: Path, stream: XdfStream, start: float) -> TrackFile:
    """Return tracks with times in s from `start`, in the order of the markers' numbers."""
    markers = _marker_columns(stream)
    labels = sorted(markers, key=_end_number)
    columns = np.array([[markers[label][axis] for axis in "xyz"] for label in labels])
    is_kept = increasing_times(stream.time)
    points = stream.values[is_kept][:, columns] * _mm_per_unit(path, stream, columns)
    points[~np.isfinite(points).all(axis=2)] = np.nan
    time = stream.time[is_kept] - start
    return labeled_tracks(path, time, np.arange(len(time)), labels, points, is_own=False)


def _end_number(label: str) -> int:
    match = _END_NUMBER.search(label)
    return int(match[0]) if match else -1


def _mm_per_unit(path: Path, stream: XdfStream, columns: Int) -> float:
    """Return mm per unit of some columns; mm if no unit is stated."""
    units = sorted({stream.units[k] for k in columns.ravel()})
    factors = {1.0 if unit == "" else mm_per_unit(unit) for unit in units}
    unknown = [unit for unit in units if unit and mm_per_unit(unit) is None]
    factor = factors.pop()
    if factor is None or factors:
        raise TrainingError(
            f"markers of the stream {stream.name!r} have the unit"
            f" {', '.join(map(repr, unknown or units))}",
            code="unknown-unit" if unknown else "units-mixed",
            where=path,
            action="Give all markers in one of mm, cm and m",
            units=tuple(unknown or units),
        )
    return factor
