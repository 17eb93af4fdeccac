"""Datasets of XDF files, in which programs record streams of the Lab Streaming Layer, by pyxdf."""

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
from ...core.markers import Markers, Tracks
from ..data.dataset import Dataset
from .pair_dataset import QUIET, Offset, of_series
from .series import OHM, Series, series_of
from .session_dataset import rising

_MAGIC = b"XDF:"
_PLACE = re.compile(r"^(?:[a-z_ ]*?)(\d{1,15})[_. -]([xyz])$", re.IGNORECASE)
_MM = {"": 1.0, "mm": 1.0, "millimeters": 1.0, "cm": 10.0, "m": 1000.0, "meters": 1000.0}
_OHM = {"ohm": 1.0, "ohms": 1.0, "Ω": 1.0, "kohm": 1000.0, "kohms": 1000.0, "kΩ": 1000.0}
_PLAIN = ("", "1", "none", "normalized", "relative")


@dataclass(frozen=True)
class _Stream:
    """n samples (n, k) at `time` (n,) s, with `labels` and `units` (k), empty where not given."""

    name: str
    kind: str
    labels: tuple[str, ...]
    units: tuple[str, ...]
    time: Float
    values: Float

    @property
    def told(self) -> str:
        """In words."""
        of = ", ".join(self.labels[:4]) + (", ..." if len(self.labels) > 4 else "")
        return f"{self.name!r} (type {self.kind!r}, {of or 'channels without labels'})"

    @property
    def tags(self) -> dict[int, dict[str, int]]:
        """Columns of x, y and z by the markers' numbers."""
        out: dict[int, dict[str, int]] = {}
        for k, label in enumerate(self.labels):
            if found := _PLACE.match(label):
                out.setdefault(int(found[1]), {})[found[2].lower()] = k
        return {number: axes for number, axes in sorted(out.items()) if len(axes) == 3}


def xdf_dataset(
    path: Path, *, signals: str | None = None, tracks: str | None = None,
    device: str | None = None, layout: str = "", unit: str = "", markers: Markers | None = None,
    offset: Offset = 0.0, quiet: float = QUIET, called: str = "",
) -> Dataset:  # fmt: skip
    """One recording of an .xdf or .xdfz file: a stream of `signals` (or resistances: unit ohm, or
    labels that end in `_ohm`) and one of `tracks` (labels `tag_1_x`, `tag_1_y`, ... or `1_x`; mm,
    or the unit they have), by their names or types, or by their labels. Clocks are those of the
    Lab Streaming Layer; the rest as for `pair_dataset`. Raises TrainingError, naming the streams
    found."""
    streams = _read(path)
    places = _choose(path, streams, tracks, "markers", [s for s in streams if s.tags])
    others = [s for s in streams if s is not places and any(s.labels) and not s.tags]
    said = _choose(path, streams, signals, "signals", others)
    if not places.tags:
        raise TrainingError(
            f"{path}: the stream {places.told} has no markers; label its channels tag_1_x, tag_1_y,"
            " tag_1_z, ..."
        )
    start = float(min(places.time[:1].min(initial=np.inf), said.time[:1].min(initial=np.inf)))
    series = _series(path, said, start)
    return of_series(
        series, _tracks(path, places, start), f"{path}, {places.name}", device=device,
        layout=layout, unit=unit, markers=markers, offset=offset, quiet=quiet,
        called=called,
    )  # fmt: skip


def _choose(
    path: Path, streams: Sequence[_Stream], wanted: str | None, what: str, like: list[_Stream]
) -> _Stream:
    """The stream of a name or type, or the only one that is like it."""
    if wanted is not None:
        like = [s for s in streams if s.name == wanted] or [s for s in streams if s.kind == wanted]
    if len(like) == 1:
        return like[0]
    have = "; ".join(s.told for s in streams) or "none of numbers"
    if wanted is not None:
        why = f"has {len(like) or 'no'} stream{'s' if len(like) > 1 else ''} {wanted!r}"
    elif not like:
        label = "tag_1_x, tag_1_y, tag_1_z, ..." if what == "markers" else "the cords' names"
        why = f"has no stream of {what} (channels labelled {label})"
    else:
        why = f"has {len(like)} streams that may be the {what}; say which by its name"
    raise TrainingError(f"{path}: {why}; there are: {have}")


def _series(path: Path, stream: _Stream, start: float) -> Series:
    names, factor = [], []
    for label, unit in zip(stream.labels, stream.units, strict=True):
        if unit in _OHM:
            names.append(label if label.endswith(OHM) else label + OHM)
            factor.append(_OHM[unit])
        elif unit.lower() in _PLAIN or (unit == "%" and not label.endswith(OHM)):
            resists = "resist" in stream.kind.lower() and not label.endswith(OHM)
            names.append(label + OHM if resists and unit == "" else label)
            factor.append(0.01 if unit == "%" else 1.0)
        else:
            raise TrainingError(
                f"{path}: {label} of the stream {stream.name!r} has the unit {unit!r}; signals"
                " have none, resistances ohm or kohm"
            )
    blank = [k for k, label in enumerate(stream.labels) if not label]
    if blank or len(set(names)) < len(names):
        raise TrainingError(
            f"{path}: the channels of the stream {stream.told} need labels, all different: the"
            " cords' names"
        )
    values = stream.values * np.array(factor)
    return series_of(f"{path}, {stream.name}", names, stream.time - start, values)


def _tracks(path: Path, stream: _Stream, start: float) -> Tracks:
    tags = stream.tags
    columns = np.array([[axes[a] for a in "xyz"] for axes in tags.values()])
    units = {stream.units[k].lower() for k in columns.ravel()}
    unknown = sorted(units - set(_MM))
    if unknown or len(units) > 1:
        raise TrainingError(
            f"{path}: markers of the stream {stream.name!r} have the unit"
            f" {', '.join(map(repr, unknown or sorted(units)))}; it must be mm, cm or m for all"
        )
    kept = rising(stream.time)
    time = stream.time[kept] - start
    points = stream.values[kept][:, columns] * _MM[units.pop()]
    points[~np.isfinite(points).all(axis=2)] = np.nan
    ids, frame = np.array(list(tags), np.int64), np.arange(len(time))
    return Tracks(time, ids, points, np.full(points.shape, np.nan), frame)


def _read(path: Path) -> list[_Stream]:
    """The streams of numbers."""
    with optional(TrainingError, path, "exchange"):
        import pyxdf
    try:
        with path.open("rb") as file:
            head = file.read(len(_MAGIC))
    except OSError as error:
        raise TrainingError(f"{path}: cannot be read: {error.strerror}; check the path") from None
    packed = path.suffix.lower() == ".xdfz" or head[:2] == b"\x1f\x8b"
    if not packed and head != _MAGIC:
        raise TrainingError(f"{path}: is no XDF file (it does not begin with {_MAGIC.decode()})")
    damaged = f"{path}: is cut or damaged: {{}}; copy it again, or record anew"
    with _complaints(pyxdf) as complaints:
        try:
            found, _ = pyxdf.load_xdf(str(path))
        except Exception as error:  # whatever a damaged file makes the library throw
            why = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
            raise TrainingError(damaged.format(why)) from None
    if complaints:
        raise TrainingError(damaged.format(complaints[0][:120]))
    for each in found:
        count = _text(each.get("footer", {}).get("info"), "sample_count")
        if count.isdecimal() and int(count) != len(each["time_stamps"]):
            name = _text(each["info"], "name")
            had = f"{len(each['time_stamps'])} of {count} samples of the stream {name!r}"
            raise TrainingError(damaged.format(f"has {had}"))
    return [s for s in map(_stream, found) if s is not None]


@contextmanager
def _complaints(pyxdf: Any) -> Iterator[list[str]]:
    """What the library says of damage, which it skips in silence but for its log."""
    said: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            said.append(record.getMessage())

    logger, listener = pyxdf.pyxdf.logger, Listener(logging.ERROR)
    spread, logger.propagate = logger.propagate, False
    logger.addHandler(listener)
    try:
        yield said
    finally:
        logger.removeHandler(listener)
        logger.propagate = spread


def _stream(found: dict[str, Any]) -> _Stream | None:
    """None for texts."""
    info = found["info"]
    if _text(info, "channel_format") == "string" or not len(found["time_stamps"]):
        return None
    values = np.asarray(found["time_series"], float)
    channels = _inside(_inside(info, "desc"), "channels").get("channel") or []
    labels = [_text(c, "label").strip() for c in channels]
    units = [_text(c, "unit").strip() for c in channels]
    k = values.shape[1]
    return _Stream(
        _text(info, "name"), _text(info, "type"), tuple((labels + [""] * k)[:k]),
        tuple((units + [""] * k)[:k]), np.asarray(found["time_stamps"], float), values,
    )  # fmt: skip


def _inside(element: Any, name: str) -> dict[str, Any]:
    """The first child of an XML element, as pyxdf gives them."""
    first = (element.get(name) or [None])[0] if isinstance(element, dict) else None
    return first if isinstance(first, dict) else {}


def _text(element: Any, name: str) -> str:
    first = (element.get(name) or [None])[0] if isinstance(element, dict) else None
    return first if isinstance(first, str) else ""
