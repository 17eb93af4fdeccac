"""Write samples to a recording as they arrive, read recordings, and play them back.

A recording is a text file that spreadsheets open. Its columns are `host_ns, device_us, counter,
led, late, averages, s1, s2, ...`, where `s1, s2, ...` are the sums of conversions as the read-out
board sent them. Between the rows, lines `# {...}` hold one JSON object each: an event (start, gap,
resumed) or a step of a protocol. Lines are only appended, so a process that dies loses at most the
line that it was writing (see `core.storage.append_log`).
"""

from __future__ import annotations

import json
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import CaptureError
from ...core.storage.append_log import AppendLog, LogLines
from ...sensing.serial_frames import NOT_READ, Info, Sample
from ...sensing.voltage_divider import Dividers
from .source import Event, PacedSamples, StampedSample

#: First line of a recording.
FIRST_LINE = "# defsense recording 1"
_COLUMNS = ("host_ns", "device_us", "counter", "led", "late", "averages")
_AVERAGES = _COLUMNS.index("averages")
MAX_FULL_SCALE = 1e9
PAUSE_BETWEEN_RUNS_NS = 1_000_000_000  # when a file with several runs is played


class Recorder:
    """Writes a recording, or continues one.

    Args:
        path: File to write; a recording of the same number of channels is continued.
        channels: Number of channels.

    Raises:
        CaptureError: If the file is not a recording of `channels` channels, or another program
            writes to it.
        StorageError: If the file cannot be written.
    """

    def __init__(self, path: Path, channels: int) -> None:
        self._path, self._channels = path, channels
        head = f"{FIRST_LINE}\n{','.join([*_COLUMNS, *_channel_columns(channels)])}"
        self._log = AppendLog(path, head, f"recording of {channels} channels")

    def add(self, item: StampedSample | Event) -> None:
        """Write a sample or an event.

        Raises:
            CaptureError: If the sample has another number of channels.
            StorageError: If it cannot be written.
        """
        if isinstance(item, Event):
            data = {"event": item.kind, "host_ns": item.host_ns, **item.data}
            self._log.line(f"# {json.dumps(data)}")
            return
        s = item.sample
        if len(s.sums) != self._channels:
            raise CaptureError(
                f"a frame of {len(s.sums)} channels arrived in a recording of {self._channels}",
                code="channels-differ",
                where=self._path,
                action="Close other programs that change the read-out board's settings",
                channels=self._channels,
                count=len(s.sums),
            )
        values = (item.host_ns, item.device_us, s.counter, int(s.led), int(s.late), s.averages)
        self._log.line(",".join(map(str, values + s.sums)))

    def extend(self, items: Iterable[StampedSample | Event]) -> None:
        """Write several samples and events."""
        for item in items:
            self.add(item)

    def close(self) -> None:
        """Write buffered data to the disk; later writes raise StorageError."""
        self._log.close()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _channel_columns(channels: int) -> list[str]:
    return [f"s{i + 1}" for i in range(channels)]


@dataclass(frozen=True)
class Recording:
    """A recording of t frames of c channels.

    Attributes:
        path: File that was read.
        host_ns: The host's clock (t,), ns.
        device_us: The device's clock (t,), us.
        counter: Counters of the samples (t,).
        led: Whether the board's LED was on (t,), 0 or 1.
        late: Whether the sample was late (t,), 0 or 1.
        averages: Conversions per sample (t,).
        sums: Sums of conversions (t, c), NOT_READ where a converter did not answer.
        full_scale: Counts at the dividers' supply voltage (t,), as last reported by the board;
            NaN before the first report.
        events: Each event with the number of frames before it.
        damaged_lines: Number of lines that were cut or damaged and are left out.
    """

    path: Path
    host_ns: Int
    device_us: Int
    counter: Int
    led: Int
    late: Int
    averages: Int
    sums: Int
    full_scale: Float
    events: tuple[tuple[int, dict[str, Any]], ...]
    damaged_lines: int

    @property
    def counts(self) -> Float:
        """Mean counts of a conversion (t, c), NaN where not read."""
        return self._counts(slice(None))

    def resistances(self, reference: Float, part: slice = slice(None)) -> Float:
        """Return the channels' resistances.

        Args:
            reference: Reference resistors of the dividers (c,), ohm.
            part: Frames to convert; all by default.

        Returns:
            Resistances (t, c), ohm, NaN where not read.

        Raises:
            CaptureError: If no event before these frames states the board's full scale.
        """
        scale = self.full_scale[part]
        if np.isnan(scale).any():
            frame = part.indices(len(self.counter))[0] + int(np.argmax(np.isnan(scale))) + 1
            raise CaptureError(
                f"no event before frame {frame} states the read-out board's full scale, because"
                " the line of its 'start' event was lost",
                code="full-scale-unknown",
                where=self.path,
                action=(
                    """Add '# {"event": "start", "full_scale": 1024}' below the columns, with"""
                    " this board's number, or record again"
                ),
                frame=frame,
            )
        return Dividers(reference, scale[:, None]).resistance(self._counts(part))

    def _counts(self, part: slice) -> Float:
        sums, averages = self.sums[part], self.averages[part, None]
        return np.asarray(np.where(sums == NOT_READ, np.nan, sums / averages))


def read_recording(path: Path) -> Recording:
    """Read a recording, finished or not; cut and damaged lines are left out.

    Raises:
        CaptureError: If the file is not a recording, or one of its lines is invalid.
    """
    lines = LogLines(path)
    names: list[str] = []
    cells = array("q")
    events: list[tuple[int, dict[str, Any]]] = []
    scales = [(0, float("nan"))]
    for number, line in _lines_after_first(path, lines):
        if not names:
            names = line.split(",")
            if number != 2 or tuple(names[: len(_COLUMNS)]) != _COLUMNS:
                raise CaptureError(
                    f"the columns must start with {','.join(_COLUMNS)}",
                    code="header-wrong",
                    where=f"{path}:2",
                    action="Record again",
                    line=2,
                )
        elif line.startswith("#"):
            frame, event = len(cells) // len(names), parse_event(path, number, line[1:])
            events.append((frame, event))
            if "full_scale" in event:
                scales.append((frame, _full_scale(path, number, event)))
        elif line:
            _parse_frame(path, number, line, len(names), cells)
    names = names or [*_COLUMNS, "s1"]
    table = np.frombuffer(cells, np.int64).reshape(-1, len(names))
    columns = {name: table[:, i] for i, name in enumerate(_COLUMNS)}
    first_frames, values = zip(*scales, strict=True)
    full_scale = np.repeat(values, np.diff([*first_frames, len(table)]))
    return Recording(
        path,
        **columns,
        sums=table[:, len(_COLUMNS) :],
        full_scale=full_scale,
        events=tuple(events),
        damaged_lines=lines.skipped,
    )


def has_frames(path: Path) -> bool:
    """Return whether a recording has a frame.

    Raises:
        CaptureError: If the file is not a recording.
    """
    return any(line[:1].isdigit() for _, line in _lines_after_first(path, LogLines(path)))


def _lines_after_first(path: Path, lines: LogLines) -> Iterator[tuple[int, str]]:
    """Return a recording's numbered lines from the second on.

    A file whose first line was cut while it was written has none. Another first line raises
    CaptureError.
    """
    rest = iter(lines)
    first = next(rest, None)
    may_be_cut = first is None and path.stat().st_size <= len(FIRST_LINE)
    if may_be_cut and FIRST_LINE.encode().startswith(path.read_bytes()):
        return iter(())
    if first != (1, FIRST_LINE):
        raise CaptureError(
            f"is not a recording (its first line is not {FIRST_LINE!r})",
            code="not-a-recording",
            where=path,
            action="Choose another file",
        )
    return rest


def _parse_frame(path: Path, number: int, line: str, width: int, cells: array[int]) -> None:
    """Append the `width` cells of a frame's line."""
    where = f"{path}:{number}"
    row = line.split(",")
    if len(row) != width:
        raise CaptureError(
            f"has {len(row)} cells, but there are {width} columns",
            code="cell-count-differs",
            where=where,
            action="Delete the line",
            line=number,
            count=len(row),
        )
    try:
        cells.extend(map(int, row))
    except (ValueError, OverflowError) as error:
        raise CaptureError(
            f"a cell of the frame is not a number: {error}",
            code="not-a-number",
            where=where,
            action="Delete the line",
            line=number,
        ) from None
    if cells[_AVERAGES - width] < 1:
        raise CaptureError(
            "the frame sums no conversions (column averages)",
            code="frame-without-conversions",
            where=where,
            action="Delete the line",
            line=number,
        )


def parse_event(path: Path, number: int, text: str) -> dict[str, Any]:
    """Return the JSON object on a line of a file.

    Raises:
        CaptureError: If the text is not a JSON object.
    """
    try:
        event = json.loads(text)
        if not isinstance(event, dict):
            raise ValueError
    except ValueError:
        raise CaptureError(
            f"is not an event: {text[:60]!r}",
            code="event-invalid",
            where=f"{path}:{number}",
            action="Delete the line",
            line=number,
        ) from None
    return event


def _full_scale(path: Path, number: int, event: dict[str, Any]) -> float:
    scale = event["full_scale"]
    is_number = isinstance(scale, int | float) and not isinstance(scale, bool)
    if not is_number or not 0 < scale < MAX_FULL_SCALE:
        raise CaptureError(
            f"full_scale must be a number above zero, not {scale!r}",
            code="full-scale-invalid",
            where=f"{path}:{number}",
            action="Write this read-out board's number there, or record again",
            value=scale,
        )
    return float(scale)


class Replay(PacedSamples):
    """A `Source` that plays a recording.

    Args:
        path: Recording to play.
        speed: Playback speed relative to the recording's own.
    """

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        super().__init__(str(path))
        self._path, self._speed = path, speed

    def start(self) -> Info:
        """Start playing and return the board's description from the recording.

        Raises:
            CaptureError: If the file is not a recording, is empty, or does not describe the board.
        """
        recording = read_recording(self._path)
        names = set(Info.__dataclass_fields__)
        board = next((e for _, e in recording.events if names <= set(e)), None)
        if not len(recording.counter):
            raise CaptureError(
                "has no samples to play",
                code="recording-empty",
                where=self.name,
                action="Choose another recording",
            )
        if board is None:
            raise CaptureError(
                "no event describes the read-out board, because the line of its 'start' event was"
                " lost",
                code="unknown-board",
                where=self.name,
                action=(
                    "Copy that line from another recording of this board below the columns, or"
                    " record again"
                ),
            )
        host_ns, device_us = _joined_clocks(recording)

        def sample(k: int) -> tuple[int, Sample]:
            micros, sums = int(device_us[k]), tuple(int(s) for s in recording.sums[k])
            flags = bool(recording.led[k]), bool(recording.late[k]), int(recording.averages[k])
            return micros, Sample(int(recording.counter[k]), micros % (1 << 32), *flags, sums)

        self._play((host_ns / self._speed).astype(np.int64), sample)
        return Info(**{n: board[n] for n in names})


def _joined_clocks(recording: Recording) -> tuple[Int, Int]:
    """Return arrival times, ns from the first, and the device's clock, us.

    Both clocks start again in each run that was recorded into the file. Runs are joined, a pause
    apart.
    """
    starts = {frame for frame, event in recording.events if event.get("event") == "start"}
    host_step = np.diff(recording.host_ns, prepend=recording.host_ns[:1])
    device_step = np.diff(recording.device_us, prepend=0)
    is_start = np.isin(np.arange(len(host_step)), [frame for frame in starts if frame > 0])
    is_new_run = (host_step < 0) | is_start
    device_step[0] = recording.device_us[0]
    return np.cumsum(np.where(is_new_run, PAUSE_BETWEEN_RUNS_NS, host_step)), np.cumsum(
        np.where(is_new_run, PAUSE_BETWEEN_RUNS_NS // 1000, device_step)
    )
