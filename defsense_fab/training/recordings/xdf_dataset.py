"""Make datasets of XDF files, in which programs record streams of the Lab Streaming Layer."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...core.machine.optional_libraries import optional
from ...core.markers import Tracks
from ..data.dataset import Dataset
from .pair_dataset import RecordingInfo, dataset_of_series
from .series import OHM, Series, increasing_times, make_series

_MAGIC = b"XDF:"
_GZIP_MAGIC = b"\x1f\x8b"
_COORDINATE = re.compile(r"^(?:[a-z_ ]*?)(\d{1,15})[_. -]([xyz])$", re.IGNORECASE)
_MM_PER_UNIT = {"": 1.0, "mm": 1.0, "millimeters": 1.0, "cm": 10.0, "m": 1000.0, "meters": 1000.0}
_OHM_PER_UNIT = {"ohm": 1.0, "ohms": 1.0, "Ω": 1.0, "kohm": 1000.0, "kohms": 1000.0, "kΩ": 1000.0}
_NO_UNIT = ("", "1", "none", "normalized", "relative")
_MAX_REASON_CHARACTERS = 120


@dataclass(frozen=True)
class _Stream:
    """A stream of numbers.

    Attributes:
        name: Name of the stream.
        kind: Its type.
        labels: Labels of the k channels; empty where not given.
        units: Units of the channels; empty where not given.
        time: Times of the n samples, shape (n,), s.
        values: Samples, shape (n, k).
    """

    name: str
    kind: str
    labels: tuple[str, ...]
    units: tuple[str, ...]
    time: Float
    values: Float

    @property
    def description(self) -> str:
        """Name, type and labels, for messages."""
        labels = ", ".join(self.labels[:4]) + (", ..." if len(self.labels) > 4 else "")
        return f"{self.name!r} (type {self.kind!r}, {labels or 'channels without labels'})"

    @property
    def markers(self) -> dict[int, dict[str, int]]:
        """Columns of x, y and z by the markers' numbers."""
        columns: dict[int, dict[str, int]] = {}
        for k, label in enumerate(self.labels):
            if match := _COORDINATE.match(label):
                columns.setdefault(int(match[1]), {})[match[2].lower()] = k
        return {number: axes for number, axes in sorted(columns.items()) if len(axes) == 3}


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
    stated). Clocks are those of the Lab Streaming Layer.

    Args:
        path: The file.
        info: Facts that the file does not state.
        signals: Name or type of the stream of signals; None to detect it by its labels.
        tracks: Name or type of the stream of tracks; None to detect it by its labels.

    Returns:
        The dataset, with one recording.

    Raises:
        TrainingError: If the file cannot be read or has no such streams; those found are stated.
    """
    streams = _read_streams(path)
    marker_stream = _choose(path, streams, tracks, "markers", [s for s in streams if s.markers])
    others = [s for s in streams if s is not marker_stream and any(s.labels) and not s.markers]
    signal_stream = _choose(path, streams, signals, "signals", others)
    if not marker_stream.markers:
        raise TrainingError(
            f"the stream {marker_stream.description} has no markers",
            code="no-markers",
            where=path,
            action="Label its channels tag_1_x, tag_1_y, tag_1_z, ...",
            stream=marker_stream.name,
        )
    first_times = (s.time[:1].min(initial=np.inf) for s in (marker_stream, signal_stream))
    start = float(min(first_times))
    series = _to_series(path, signal_stream, start)
    return dataset_of_series(
        series,
        _to_tracks(path, marker_stream, start),
        f"{path}, {marker_stream.name}",
        info or RecordingInfo(),
    )


def _choose(
    path: Path,
    streams: Sequence[_Stream],
    requested: str | None,
    content: str,
    candidates: list[_Stream],
) -> _Stream:
    """Return the stream of the requested name or type, or the only candidate."""
    if requested is not None:
        candidates = [s for s in streams if s.name == requested]
        candidates = candidates or [s for s in streams if s.kind == requested]
    if len(candidates) == 1:
        return candidates[0]
    if requested is not None:
        count = len(candidates)
        problem = f"has {count or 'no'} stream{'s' if count > 1 else ''} {requested!r}"
        action = "Name one stream"
    elif not candidates:
        problem = f"has no stream of {content}"
        labels = "tag_1_x, tag_1_y, tag_1_z, ..." if content == "markers" else "by the cords' names"
        action = f"Label its channels {labels}"
    else:
        problem = f"has {len(candidates)} streams that may be the {content}"
        action = f"Name the stream of {content}"
    descriptions = "; ".join(s.description for s in streams) or "none with numbers"
    raise TrainingError(
        f"{problem}; its streams are: {descriptions}",
        code="stream-not-found" if not candidates else "stream-ambiguous",
        where=path,
        action=action,
        content=content,
        streams=tuple(s.name for s in streams),
    )


def _to_series(path: Path, stream: _Stream, start: float) -> Series:
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


def _to_tracks(path: Path, stream: _Stream, start: float) -> Tracks:
    """Return tracks with times in s from `start`."""
    markers = stream.markers
    columns = np.array([[axes[a] for a in "xyz"] for axes in markers.values()])
    units = {stream.units[k].lower() for k in columns.ravel()}
    unknown = sorted(units - set(_MM_PER_UNIT))
    if unknown or len(units) > 1:
        raise TrainingError(
            f"markers of the stream {stream.name!r} have the unit"
            f" {', '.join(map(repr, unknown or sorted(units)))}",
            code="unknown-unit" if unknown else "units-mixed",
            where=path,
            action="Give all markers in one of mm, cm and m",
            units=tuple(unknown or sorted(units)),
        )
    is_kept = increasing_times(stream.time)
    time = stream.time[is_kept] - start
    points = stream.values[is_kept][:, columns] * _MM_PER_UNIT[units.pop()]
    points[~np.isfinite(points).all(axis=2)] = np.nan
    ids, frame = np.array(list(markers), np.int64), np.arange(len(time))
    return Tracks(time, ids, points, np.full(points.shape, np.nan), frame)


def _read_streams(path: Path) -> list[_Stream]:
    """Return the streams of numbers."""
    with optional(TrainingError, path, "exchange"):
        import pyxdf
    _check_header(path)
    with _record_errors(pyxdf) as errors:
        try:
            contents, _ = pyxdf.load_xdf(str(path))
        except Exception as error:  # damaged files make the library raise errors of any kind
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise _damaged(path, reason[:_MAX_REASON_CHARACTERS]) from None
    if errors:
        raise _damaged(path, errors[0][:_MAX_REASON_CHARACTERS])
    for content in contents:
        stated = _text(content.get("footer", {}).get("info"), "sample_count")
        count = len(content["time_stamps"])
        if stated.isdecimal() and int(stated) != count:
            name = _text(content["info"], "name")
            raise _damaged(path, f"has {count} of {stated} samples of the stream {name!r}")
    return [s for s in map(_to_stream, contents) if s is not None]


def _check_header(path: Path) -> None:
    try:
        with path.open("rb") as file:
            header = file.read(len(_MAGIC))
    except OSError as error:
        raise TrainingError(
            f"cannot be read: {error.strerror}",
            code="file-unreadable",
            where=path,
            action="Check the path",
        ) from None
    is_compressed = path.suffix.lower() == ".xdfz" or header[: len(_GZIP_MAGIC)] == _GZIP_MAGIC
    if not is_compressed and header != _MAGIC:
        raise TrainingError(
            f"is not an XDF file (it does not start with {_MAGIC.decode()})",
            code="wrong-file-format",
            where=path,
        )


def _damaged(path: Path, reason: str) -> TrainingError:
    return TrainingError(
        f"is truncated or damaged: {reason}",
        code="file-damaged",
        where=path,
        action="Copy it again, or record again",
    )


@contextmanager
def _record_errors(pyxdf: Any) -> Iterator[list[str]]:
    """Yield the errors that the library logs; it skips damaged parts without raising."""
    messages: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            messages.append(record.getMessage())

    logger, listener = pyxdf.pyxdf.logger, Listener(logging.ERROR)
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(listener)
    try:
        yield messages
    finally:
        logger.removeHandler(listener)
        logger.propagate = propagate


def _to_stream(content: dict[str, Any]) -> _Stream | None:
    """Return a stream as read by pyxdf; None for text and empty streams."""
    info = content["info"]
    if _text(info, "channel_format") == "string" or not len(content["time_stamps"]):
        return None
    values = np.asarray(content["time_series"], float)
    channels = _child(_child(info, "desc"), "channels").get("channel") or []
    labels = [_text(c, "label").strip() for c in channels]
    units = [_text(c, "unit").strip() for c in channels]
    k = values.shape[1]
    return _Stream(
        name=_text(info, "name"),
        kind=_text(info, "type"),
        labels=tuple((labels + [""] * k)[:k]),
        units=tuple((units + [""] * k)[:k]),
        time=np.asarray(content["time_stamps"], float),
        values=values,
    )


def _child(element: Any, name: str) -> dict[str, Any]:
    """Return the first child of an XML element, as pyxdf represents them."""
    first = (element.get(name) or [None])[0] if isinstance(element, dict) else None
    return first if isinstance(first, dict) else {}


def _text(element: Any, name: str) -> str:
    first = (element.get(name) or [None])[0] if isinstance(element, dict) else None
    return first if isinstance(first, str) else ""
