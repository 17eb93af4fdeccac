"""A recording as a source: its samples come again, at the pace at which they came."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from ...core.arrays import Int
from ...core.errors import CaptureError
from ...sensing.serial_frames import Info, Sample
from .recording import Recording, read_recording
from .source import Event, ReadoutStatistics, RecordingEnd, Sink, StaleError, StampedSample

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


class Replay:
    """A `Source` that plays `path`, `speed` times as fast as it was recorded."""

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        self.name, self._path, self._speed = str(path), path, speed
        self._next, self._begun = 0, 0
        self._host = self._micros = np.zeros(0, np.int64)
        self._latest: StampedSample | None = None
        self._recording: Recording | None = None
        self.sink: Sink | None = None

    def start(self) -> Info:
        """Raises CaptureError for a file that is no recording, an empty one, or one that does not
        tell what the read-out board was."""
        r = self._recording = read_recording(self._path)
        names = set(Info.__dataclass_fields__)
        about = next((e for _, e in r.events if names <= set(e)), None)
        if not len(r.counter):
            raise CaptureError(f"{self.name}: has no samples to play")
        if about is None:
            raise CaptureError(
                f"{self.name}: no event tells what the read-out board was: the line of its"
                " 'start' was lost; copy that of another recording of this read-out board below"
                " the columns, or record again"
            )
        self._host, self._micros = _one_run(r)
        self._begun = time.monotonic_ns()
        return Info(**{n: about[n] for n in names})

    def drain(self) -> list[StampedSample | Event]:
        r = self._recording
        if r is None:
            raise CaptureError(f"{self.name}: is not being played")
        if self._next >= len(r.counter):
            raise RecordingEnd(f"{self.name}: the recording is at its end")
        now = time.monotonic_ns()
        out: list[StampedSample | Event] = []
        while self._next < len(r.counter):
            i = self._next
            due = self._begun + int(self._host[i] / self._speed)
            if due > now:
                break
            sums = tuple(int(s) for s in r.sums[i])
            flags = bool(r.led[i]), bool(r.late[i]), int(r.averages[i])
            micros = int(self._micros[i])
            sample = Sample(int(r.counter[i]), micros % (1 << 32), *flags, sums)
            self._latest = StampedSample(due, micros, sample)
            if self.sink is not None:
                self.sink(self._latest)
            out.append(self._latest)
            self._next += 1
        return out

    def read_latest(self, max_age: float) -> StampedSample:
        if self._latest is None or time.monotonic_ns() - self._latest.host_ns > max_age * 1e9:
            raise StaleError(f"{self.name}: no sample of the last {max_age:g} s; drain() plays")
        return self._latest

    @property
    def statistics(self) -> ReadoutStatistics:
        return ReadoutStatistics(samples=self._next)

    def close(self) -> None:
        self._recording = None
