"""Sources of a live run of a sensor that is no device: a table of signals, or lines of text."""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from ...capture.readout.recording import FIRST_LINE
from ...capture.readout.source import (
    Event,
    PacedSamples,
    ReadoutStatistics,
    RecordingEnd,
    Sink,
    StaleError,
    StampedSample,
)
from ...core.arrays import Float
from ...core.errors import LiveError
from ...decoding.quantities import COUNTS, RELATIVE, Readings
from ...decoding.trained_model import TrainedModel
from ...runtime.outputs.live_file import LiveSettings
from ...runtime.outputs.settings import KINDS, GamepadSettings, MidiSettings
from ...sensing.serial_frames import Info, Sample
from ...training.recordings.column_units import Column, find_time, parse_column
from ...training.recordings.table_dataset import read_columns
from .options import RunOptions
from .sources import TWIN

#: Port of lines of text on standard input.
STDIN = "stdin"
_MICROS_RANGE = 1 << 32
_MAX_WAITING = 10_000  # samples and events that wait to be drained
_MIN_EVENT_INTERVAL_S = 1.0  # between reports of lines that are no samples
_FULL_SCALE = 1


@dataclass(frozen=True)
class ReadingSample(Sample):
    """A sample of readings that need no conversion.

    Attributes:
        values: Reading of each channel in the unit of the model; NaN without a value.
    """

    values: tuple[float, ...] = ()

    @property
    def counts(self) -> Float:
        """The readings (c,)."""
        return np.array(self.values)


class TablePlay(PacedSamples):
    """A `Source` that plays a table of signals at its own pace.

    Args:
        path: The table.
        channels: Names of the model's channels, in its order.
        readings: Their units.

    Raises:
        LiveError: The table lacks a channel, or has one in another unit.
        TrainingError: The file is not such a table.
    """

    def __init__(self, path: Path, channels: Sequence[str], readings: Readings) -> None:
        super().__init__(str(path))
        columns, self._time, values = read_columns(path)
        order = find_channels(columns, channels, readings, str(path))
        self._values = values[:, order]

    def start(self) -> Info:
        """Start playing; return a description of the table as a read-out board."""
        delays = np.rint(1e9 * (self._time - self._time[0])).astype(np.int64)

        def sample(k: int) -> tuple[int, Sample]:
            micros = round(1e6 * float(self._time[k]))
            return micros, _sample(k, micros, self._values[k])

        self._play(delays, sample)
        return _info(self._values.shape[1], float(np.median(np.diff(self._time))))


class TextLines:
    """A `Source` of lines of text: a header that names the columns, then a line for each sample.

    Without a column of times, samples have the time at which they arrive.

    Args:
        file: The text, such as standard input.
        channels: Names of the model's channels, in its order.
        readings: Their units.
        name: Name of the source in messages.
    """

    def __init__(
        self, file: TextIO, channels: Sequence[str], readings: Readings, name: str = STDIN
    ) -> None:
        self.name = name
        self.sink: Sink | None = None
        self._file, self._channels, self._readings = file, tuple(channels), readings
        self._items: deque[StampedSample | Event] = deque(maxlen=_MAX_WAITING)
        self._latest: StampedSample | None = None
        self._count = self._bad = self._next_report_ns = 0
        self._has_ended = False
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._order, self._factors = list[int](), np.zeros(0)
        self._time_column: int | None = None
        self._time_factor = 1.0

    def start(self) -> Info:
        """Read the header and start reading samples.

        Raises:
            LiveError: There is no header, or it lacks a channel.
        """
        header = self._file.readline()
        names = tuple(cell.strip() for cell in header.strip().split(","))
        if not header.strip():
            example = _example_header(self._channels, self._readings)
            raise LiveError(
                "has no line that names the columns",
                code="header-missing",
                where=self.name,
                action=f"Send a line such as {example} first",
            )
        found = find_time(names)
        if found is not None:
            self._time_column, self._time_factor = names.index(found[0]), found[1]
        columns = [parse_column(name) for name in names]
        self._order = find_channels(columns, self._channels, self._readings, self.name)
        self._factors = np.array([columns[k].factor for k in self._order])
        self._thread.start()
        return _info(len(self._order), 1.0)

    def drain(self) -> list[StampedSample | Event]:
        """Return the samples since the last call; raise RecordingEnd at the end of the text."""
        items = list[StampedSample | Event]()
        while self._items:
            items.append(self._items.popleft())
        if not items and self._has_ended:
            raise RecordingEnd("the text has ended", code="recording-ended", where=self.name)
        return items

    def read_latest(self, max_age: float) -> StampedSample:
        """Return the newest sample; raise StaleError if it is older than `max_age` s."""
        if self._latest is None or time.monotonic_ns() - self._latest.host_ns > max_age * 1e9:
            raise StaleError(
                f"no sample arrived within the last {max_age:g} s",
                code="reading-stale",
                where=self.name,
            )
        return self._latest

    @property
    def statistics(self) -> ReadoutStatistics:
        """Counts of the lines that were read, and of those that are no samples."""
        return ReadoutStatistics(samples=self._count, bad=self._bad)

    def close(self) -> None:
        """Do nothing: the text belongs to the caller."""

    def _read(self) -> None:
        start = time.monotonic()
        for line in self._file:
            cells = line.strip().split(",")
            if not line.strip():
                continue
            if len(cells) <= max(self._order):
                self._report_bad(line)
                continue
            values = np.array([_number(cells[k]) for k in self._order]) * self._factors
            seconds = time.monotonic() - start
            if self._time_column is not None:
                seconds = _number(cells[self._time_column]) * self._time_factor
            if not np.isfinite(seconds):
                self._report_bad(line)
                continue
            micros = round(1e6 * seconds)
            item = StampedSample(time.monotonic_ns(), micros, _sample(self._count, micros, values))
            self._count += 1
            self._latest = item
            if self.sink is not None:
                self.sink(item)
            self._items.append(item)
        self._has_ended = True

    def _report_bad(self, line: str) -> None:
        """Count a line that is no sample, and report it if none was reported recently."""
        self._bad += 1
        now = time.monotonic_ns()
        if self.sink is None or now < self._next_report_ns:
            return
        self._next_report_ns = now + round(1e9 * _MIN_EVENT_INTERVAL_S)
        self.sink(Event(now, "bad-line", {"line": line.strip()[:40], "count": self._bad}))


def open_target_source(
    port: str, path: Path | None, channels: Sequence[str], readings: Readings
) -> TablePlay | TextLines | None:
    """Return the source of a port that gives readings; None for a read-out board.

    Args:
        port: The port as the user gives it.
        path: The table that it plays, or None.
        channels: Names of the model's channels.
        readings: Their units.

    Raises:
        LiveError: The port cannot give such readings.
    """
    if port == STDIN:
        return TextLines(sys.stdin, channels, readings)
    if path is not None and not _is_recording(path):
        return TablePlay(path, channels, readings)
    if port.partition(":")[0] == TWIN:
        raise LiveError(
            "simulates a device, and the model is of another sensor",
            code="not-built",
            where=port,
            action="Play a table (replay:signals.csv), or send lines of text to --port stdin",
        )
    units = sorted(set(readings.units))
    if units != ["ohm"]:
        given = "relative changes" if units == [RELATIVE] else ", ".join(units)
        raise LiveError(
            f"a read-out board gives ohm, but the model was trained on {given}",
            code="units-differ",
            where=port,
            action="Play a table (replay:signals.csv), or send lines of text to --port stdin",
            units=tuple(units),
        )
    return None


def _is_recording(path: Path) -> bool:
    """Return whether a file is a recording of a read-out board."""
    try:
        with path.open("rb") as file:
            return file.read(len(FIRST_LINE)) == FIRST_LINE.encode()
    except OSError:
        return False


def refuse_surface(
    model: TrainedModel, options: RunOptions, settings: LiveSettings, *, has_view: bool
) -> None:
    """Raise an error for what needs a device: its surface, its poses or its rest.

    Args:
        model: The model.
        options: Options of the run.
        settings: Its outputs and controls.
        has_view: Whether a page is requested.

    Raises:
        LiveError: One of them is requested.
    """
    names = ", ".join(model.target_names)
    refused = {
        "view": (has_view, "shows the surface of a device"),
        "animation": (options.animation is not None, "records the surface of a device"),
        "rest": (options.rest is not None, "is for cords, and this model has a fixed reference"),
        "controls": (bool(settings.controls), "are the poses of a device"),
    }
    refused |= {
        kind: (True, "plays the controls of a device")
        for kind, of in KINDS.items()
        if any(
            isinstance(s, of) and isinstance(s, (MidiSettings, GamepadSettings))
            for s in settings.outputs
        )
    }
    for where, (is_given, text) in refused.items():
        if is_given:
            raise LiveError(
                f"{text}; the model decodes {names}",
                code="no-surface",
                where=where,
                action="Omit it; send the values by --output osc, websocket or lsl",
                option=where,
            )


def find_channels(
    columns: Sequence[Column], channels: Sequence[str], readings: Readings, where: str
) -> list[int]:
    """Return the index of the column of each channel.

    Args:
        columns: The columns of a table.
        channels: Names of the channels.
        readings: Their units.
        where: Name of the table, for errors.

    Raises:
        LiveError: A channel is missing, or has another unit than in the training.
    """
    names = [column.name for column in columns]
    if missing := [name for name in channels if name not in names]:
        raise LiveError(
            f"has no column {missing[0]}; its columns are {', '.join(names)}",
            code="channels-differ",
            where=where,
            action="Name the columns as in the training",
            missing=tuple(missing),
        )
    order = [names.index(name) for name in channels]
    for k, name, unit in zip(order, channels, readings.units, strict=True):
        given = columns[k].unit
        if given != unit and (given or unit not in (COUNTS, RELATIVE)):
            raise LiveError(
                f"{name} is in {given}, but the model was trained on {unit}"
                if given
                else f"{name} has no unit in its header, but the model was trained on {unit}",
                code="units-differ",
                where=where,
                action=f"Name the columns {_example_header(channels, readings)}",
                channel=name,
                units=(given, unit),
            )
    return order


def _example_header(channels: Sequence[str], readings: Readings) -> str:
    units = ("" if u in (COUNTS, RELATIVE) else f"_{u}" for u in readings.units)
    return ",".join(["time", *(name + unit for name, unit in zip(channels, units, strict=True))])


def _sample(number: int, micros: int, values: Float) -> ReadingSample:
    row = tuple(float(x) for x in values)
    return ReadingSample(number, micros % _MICROS_RANGE, False, False, 1, (), row)


def _info(channels: int, step_s: float) -> Info:
    rate = max(round(1 / max(step_s, 1e-6)), 1)
    return Info(1, (0, 0), 0, channels, 1, rate, 0, channels, _FULL_SCALE)


def _number(cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        return float("nan")
    return value if np.isfinite(value) else float("nan")
