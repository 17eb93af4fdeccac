"""The file that frames go to as they come: a line each, added and never changed.

Text that a spreadsheet opens: columns `host_ns, device_us, counter, led, late, averages, s1, s2,
...` (sums of conversions as the read-out board sent them), and between them lines `# {...}`, one
JSON object each, of what happened: start, gap, resumed, and the steps of a protocol. A process that
dies leaves all but the line that it was at (`core.append_log`)."""

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

# A recording as a source: its samples come again, at the pace at which they came.

_PAUSE = 1_000_000_000  # ns between one run of a recording and the next


def _one_run(r: Recording) -> tuple[Int, Int]:
    """When samples came, ns from the first, and the device's clock, us: of a file that several runs
    were recorded into, the next goes on where the last ended, as both clocks begin anew."""
    starts = {at for at, event in r.events if event.get("event") == "start"}
    host, micros = np.diff(r.host_ns, prepend=r.host_ns[:1]), np.diff(r.device_us, prepend=0)
    anew = (host < 0) | np.isin(np.arange(len(host)), [at for at in starts if at > 0])
    micros[0] = r.device_us[0]
    return np.cumsum(np.where(anew, _PAUSE, host)), np.cumsum(
        np.where(anew, _PAUSE // 1000, micros)
    )


class Replay(PacedSamples):
    """A `Source` that plays `path`, `speed` times as fast as it was recorded."""

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        super().__init__(str(path))
        self._path, self._speed = path, speed

    def start(self) -> Info:
        """Raises CaptureError for a file that is no recording, an empty one, or one that does not
        tell what the read-out board was."""
        r = read_recording(self._path)
        names = set(Info.__dataclass_fields__)
        about = next((e for _, e in r.events if names <= set(e)), None)
        if not len(r.counter):
            raise CaptureError(f"{self.name}: has no samples to play", code="recording-empty")
        if about is None:
            raise CaptureError(
                f"{self.name}: no event tells what the read-out board was: the line of its"
                " 'start' was lost; copy that of another recording of this read-out board below"
                " the columns, or record again",
                code="board-unknown",
            )
        host, device_us = _one_run(r)

        def sample(k: int) -> tuple[int, Sample]:
            micros, sums = int(device_us[k]), tuple(int(s) for s in r.sums[k])
            flags = bool(r.led[k]), bool(r.late[k]), int(r.averages[k])
            return micros, Sample(int(r.counter[k]), micros % (1 << 32), *flags, sums)

        self._play((host / self._speed).astype(np.int64), sample)
        return Info(**{n: about[n] for n in names})


_FIRST = "# defsense recording 1"
_COLUMNS = ("host_ns", "device_us", "counter", "led", "late", "averages")
_AVERAGES = _COLUMNS.index("averages")


class Recorder:
    """Writes a recording of `channels` channels, or goes on with one."""

    def __init__(self, path: Path, channels: int) -> None:
        """Raises CaptureError for a file that is no recording, or one of other channels, or that
        another program writes to; StorageError where it cannot be written."""
        self._path, self._channels = path, channels
        head = f"{_FIRST}\n{','.join([*_COLUMNS, *_names(channels)])}"
        self._log = AppendLog(path, head, f"recording of {channels} channels")

    def add(self, item: StampedSample | Event) -> None:
        """A frame or an event. Raises CaptureError for a frame of other channels."""
        if isinstance(item, Event):
            data = {"event": item.kind, "host_ns": item.host_ns, **item.data}
            self._log.line(f"# {json.dumps(data)}")
            return
        s = item.sample
        if len(s.sums) != self._channels:
            raise CaptureError(
                f"{self._path}: a frame of {len(s.sums)} channels came in a recording of"
                f" {self._channels}; another program changed the read-out board's settings",
                code="channels-differ",
                channels=self._channels,
                count=len(s.sums),
            )
        values = (item.host_ns, item.device_us, s.counter, int(s.led), int(s.late), s.averages)
        self._log.line(",".join(map(str, values + s.sums)))

    def extend(self, items: Iterable[StampedSample | Event]) -> None:
        """Several, as they are."""
        for item in items:
            self.add(item)

    def close(self) -> None:
        """Write out what the system still holds; what comes later is refused."""
        self._log.close()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _names(channels: int) -> list[str]:
    return [f"s{i + 1}" for i in range(channels)]


@dataclass(frozen=True)
class Recording:
    """t frames: the host's clock (t,) ns, the device's (t,) us, counters, LED and lateness (t,),
    averages (t,), sums (t, c); counts at the dividers' supply voltage, `full_scale` (t,), as the
    read-out board told them last, NaN before; events with the number of frames before each; lines
    that were cut or damaged."""

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
    cut: int

    @property
    def counts(self) -> Float:
        """Mean counts (t, c), NaN where not read."""
        return self._counts(slice(None))

    def resistances(self, reference: Float, part: slice = slice(None)) -> Float:
        """Ohm (t, c) of the frames or a `part` of them, by reference resistors (c,) ohm. Raises
        CaptureError where no event before them tells the read-out board's full scale."""
        scale = self.full_scale[part]
        if np.isnan(scale).any():
            first = part.indices(len(self.counter))[0] + int(np.argmax(np.isnan(scale)))
            raise CaptureError(
                f"{self.path}: no event before frame {first + 1} tells the read-out board's"
                " full_scale: the line of its 'start' was lost; add it below the columns, with this"
                " read-out board's number,"
                """ as '# {"event": "start", "full_scale": 1024}', or record again""",
                code="full-scale-unknown",
                frame=first + 1,
            )
        return Dividers(reference, scale[:, None]).resistance(self._counts(part))

    def _counts(self, part: slice) -> Float:
        sums, averages = self.sums[part], self.averages[part, None]
        return np.asarray(np.where(sums == NOT_READ, np.nan, sums / averages))


def read_recording(path: Path) -> Recording:
    """A recording, finished or not: lines that were cut or damaged are left out. Raises
    CaptureError with the line for what cannot be read."""
    lines = LogLines(path)
    names: list[str] = []
    cells = array("q")
    events: list[tuple[int, dict[str, Any]]] = []
    scales = [(0, float("nan"))]
    for number, line in _after_head(path, lines):
        if not names:
            names = line.split(",")
            if number != 2 or tuple(names[: len(_COLUMNS)]) != _COLUMNS:
                raise CaptureError(
                    f"{path}:2: the columns must begin with {','.join(_COLUMNS)}",
                    code="header-wrong",
                    line=2,
                )
        elif line.startswith("#"):
            at, event = len(cells) // len(names), _event(path, number, line)
            events.append((at, event))
            if "full_scale" in event:
                scales.append((at, _full_scale(event, f"{path}:{number}")))
        elif line:
            row = line.split(",")
            if len(row) != len(names):
                raise CaptureError(
                    f"{path}:{number}: {len(row)} cells under {len(names)} columns",
                    code="cell-count-differs",
                    line=number,
                    count=len(row),
                )
            try:
                cells.extend(map(int, row))
            except (ValueError, OverflowError) as error:
                raise CaptureError(
                    f"{path}:{number}: not a number in a frame: {error}",
                    code="not-a-number",
                    line=number,
                ) from None
            if cells[_AVERAGES - len(names)] < 1:
                raise CaptureError(
                    f"{path}:{number}: a frame of no conversions (averages)",
                    code="frame-without-conversions",
                    line=number,
                )
    names = names or [*_COLUMNS, "s1"]
    table = np.frombuffer(cells, np.int64).reshape(-1, len(names))
    first = len(_COLUMNS)
    columns = {name: table[:, i] for i, name in enumerate(_COLUMNS)}
    begins, values = zip(*scales, strict=True)
    full_scale = np.repeat(values, np.diff([*begins, len(table)]))
    return Recording(
        path, **columns, sums=table[:, first:], full_scale=full_scale, events=tuple(events),
        cut=lines.left_out,
    )  # fmt: skip


def has_frames(path: Path) -> bool:
    """Whether a recording has a frame. Raises CaptureError for what is none."""
    return any(line[:1].isdigit() for _, line in _after_head(path, LogLines(path)))


def _after_head(path: Path, lines: LogLines) -> Iterator[tuple[int, str]]:
    """A recording's lines from the second on; none where the first one was cut off while it was
    written. Raises CaptureError for another first one."""
    rest = iter(lines)
    first = next(rest, None)
    begun = first is None and path.stat().st_size <= len(_FIRST)
    if begun and _FIRST.encode().startswith(path.read_bytes()):
        return iter(())
    if first != (1, _FIRST):
        raise CaptureError(
            f"{path}: is no recording (its first line is not {_FIRST!r})", code="not-a-recording"
        )
    return rest


def _event(path: Path, number: int, line: str) -> dict[str, Any]:
    try:
        event = json.loads(line[1:])
        if not isinstance(event, dict):
            raise ValueError
    except ValueError:
        raise CaptureError(
            f"{path}:{number}: not an event: {line[:60]!r}", code="event-invalid", line=number
        ) from None
    return event


def _full_scale(event: dict[str, Any], where: str) -> float:
    scale = event["full_scale"]
    if isinstance(scale, bool) or not isinstance(scale, int | float) or not 0 < scale < 1e9:
        raise CaptureError(
            f"{where}: full_scale must be a number above zero, not {scale!r}; write this read-out"
            " board's number there, or record again",
            code="full-scale-invalid",
            value=scale,
        )
    return float(scale)
