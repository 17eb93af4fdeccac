"""The file that frames go to as they come: a line each, added and never changed.

Text that a spreadsheet opens: columns `host_ns, device_us, counter, led, late, averages, s1, s2,
...` (sums of conversions as the board sent them), and between them lines `# {...}`, one JSON object
each, of what happened: start, gap, resumed, and the steps of a protocol. Each line is one write, so
a process that dies leaves all but the line that it was at; the next one marks that with a ~.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import CaptureError
from ...core.files import storage_errors
from ...sensing.serial_frames import NOT_READ
from .source import Event, StampedSample

_FIRST = "# defsense recording 1"
_COLUMNS = ("host_ns", "device_us", "counter", "led", "late", "averages")
_CUT = "~"


class Recorder:
    """Writes a recording of `channels` channels, or goes on with one."""

    def __init__(self, path: Path, channels: int) -> None:
        """Raises CaptureError for a file that is no recording, or one of other channels;
        StorageError where it cannot be written."""
        self._path, self._channels = path, channels
        head = f"{_FIRST}\n{','.join([*_COLUMNS, *_names(channels)])}\n"
        with storage_errors(path):
            there = path.exists() and path.stat().st_size > 0
            if there:
                with path.open("rb") as file:
                    begins = file.read(len(head))
                    file.seek(-1, os.SEEK_END)
                    whole = file.read(1) == b"\n"
                if begins != head.encode():
                    raise CaptureError(
                        f"{path}: is no recording of {channels} channels; choose another file"
                    )
            self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
            self._claim()
            if not there:
                self._write(head)
            elif not whole:
                self._write(_CUT + "\n")

    def _claim(self) -> None:
        """Raises CaptureError where another program writes to the file (not known on Windows)."""
        try:
            import fcntl
        except ImportError:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._file)
            raise CaptureError(
                f"{self._path}: another program is recording to it; stop that first"
            ) from None

    def add(self, item: StampedSample | Event) -> None:
        """A frame or an event. Raises CaptureError for a frame of other channels."""
        if isinstance(item, Event):
            data = {"event": item.kind, "host_ns": item.host_ns, **item.data}
            self._write(f"# {json.dumps(data)}\n")
            return
        s = item.sample
        if len(s.sums) != self._channels:
            raise CaptureError(
                f"{self._path}: a frame of {len(s.sums)} channels came in a recording of"
                f" {self._channels}; another program changed the board's settings"
            )
        values = (item.host_ns, item.device_us, s.counter, int(s.led), int(s.late), s.averages)
        self._write(",".join(map(str, values + s.sums)) + "\n")

    def extend(self, items: Iterable[StampedSample | Event]) -> None:
        """Several, as they are."""
        for item in items:
            self.add(item)

    def close(self) -> None:
        """Write out what the system still holds."""
        if self._file >= 0:
            with storage_errors(self._path):
                os.fsync(self._file)
                os.close(self._file)
            self._file = -1

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, line: str) -> None:
        with storage_errors(self._path):
            data = line.encode()
            while data:
                data = data[os.write(self._file, data) :]


def _names(channels: int) -> list[str]:
    return [f"s{i + 1}" for i in range(channels)]


@dataclass(frozen=True)
class Recording:
    """t frames: the host's clock (t,) ns, the device's (t,) us, counters, LED and lateness (t,),
    averages (t,), sums (t, c); events with the number of frames before each; lines that were
    cut."""

    host_ns: Int
    device_us: Int
    counter: Int
    led: Int
    late: Int
    averages: Int
    sums: Int
    events: tuple[tuple[int, dict[str, Any]], ...]
    cut: int

    @property
    def counts(self) -> Float:
        """Mean counts (t, c), NaN where not read."""
        return np.asarray(
            np.where(self.sums == NOT_READ, np.nan, self.sums / self.averages[:, None])
        )


def read_recording(path: Path) -> Recording:
    """A recording, finished or not: what was cut is left out. Raises CaptureError with the line
    for what cannot be read."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror}") from None
    lines = text.split("\n")
    unfinished = lines.pop()
    if not lines or lines[0] != _FIRST:
        raise CaptureError(f"{path}: is no recording (its first line is not {_FIRST!r})")
    names = lines[1].split(",") if len(lines) > 1 else [*_COLUMNS, "s1"]
    if tuple(names[: len(_COLUMNS)]) != _COLUMNS:
        raise CaptureError(f"{path}:2: the columns must begin with {','.join(_COLUMNS)}")
    rows: list[list[str]] = []
    events: list[tuple[int, dict[str, Any]]] = []
    cut = int(bool(unfinished))
    for number, line in enumerate(lines[2:], 3):
        if line.endswith(_CUT) or "\0" in line or "\ufffd" in line:  # or a disk's damaged block
            cut += 1
        elif line.startswith("#"):
            try:
                event = json.loads(line[1:])
                if not isinstance(event, dict):
                    raise ValueError
                events.append((len(rows), event))
            except ValueError:
                raise CaptureError(f"{path}:{number}: not an event: {line[:60]!r}") from None
        elif line:
            cells = line.split(",")
            if len(cells) != len(names):
                raise CaptureError(
                    f"{path}:{number}: {len(cells)} cells under {len(names)} columns"
                )
            rows.append(cells)
    try:
        table = np.array(rows, dtype=np.int64).reshape(-1, len(names))
    except (ValueError, OverflowError) as error:
        raise CaptureError(f"{path}: not a number in a frame: {error}") from None
    if (table[:, _COLUMNS.index("averages")] < 1).any():
        raise CaptureError(f"{path}: a frame of no conversions (averages)")
    first = len(_COLUMNS)
    columns = {name: table[:, i] for i, name in enumerate(_COLUMNS)}
    return Recording(**columns, sums=table[:, first:], events=tuple(events), cut=cut)
