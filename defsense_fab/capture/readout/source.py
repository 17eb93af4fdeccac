"""What every source of samples can do: a port, a socket, a replayed file, a twin."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ...core.arrays import Int
from ...core.errors import CaptureError
from ...sensing.serial_frames import Info, Sample

# Samples that are known beforehand, given out as they fall due: what sources that play have in
# common.


class PacedSamples:
    """A `Source` but for its `start`, which calls `_play`."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.sink: Sink | None = None
        self._latest: StampedSample | None = None
        self._sample: Callable[[int], tuple[int, Sample]] | None = None
        self._due, self._next = np.zeros(0, np.int64), 0

    def _play(self, after_ns: Int, sample: Callable[[int], tuple[int, Sample]]) -> None:
        """From now on: samples `after_ns` (n,) ns, increasing; `sample` gives the k-th with its
        time by the device's clock, us."""
        self._due, self._next = time.monotonic_ns() + np.asarray(after_ns, np.int64), 0
        self._sample = sample

    def drain(self) -> list[StampedSample | Event]:
        """Those that have fallen due since the last call. Raises RecordingEnd after the last."""
        if self._sample is None:
            raise CaptureError(f"{self.name}: is not being played", code="source-not-started")
        if self._next >= len(self._due):
            raise RecordingEnd(f"{self.name}: the recording is at its end", code="recording-ended")
        last = int(np.searchsorted(self._due, time.monotonic_ns(), side="right"))
        out: list[StampedSample | Event] = []
        for k in range(self._next, last):
            micros, sample = self._sample(k)
            self._latest = StampedSample(int(self._due[k]), micros, sample)
            if self.sink is not None:
                self.sink(self._latest)
            out.append(self._latest)
        self._next = max(self._next, last)
        return out

    def read_latest(self, max_age: float) -> StampedSample:
        """The newest; raises StaleError where it is older than `max_age` s."""
        if self._latest is None or time.monotonic_ns() - self._latest.host_ns > max_age * 1e9:
            raise StaleError(
                f"{self.name}: no sample of the last {max_age:g} s; drain() plays",
                code="reading-stale",
            )
        return self._latest

    @property
    def statistics(self) -> ReadoutStatistics:
        """Of the samples that were given out."""
        return ReadoutStatistics(samples=self._next)

    def close(self) -> None:
        """End the playing."""
        self._sample = None


class StaleError(CaptureError):
    """There is no reading that is fresh enough."""


class RecordingEnd(CaptureError):
    """A recording that is played is at its end, which is how it should end."""


@dataclass(frozen=True)
class StampedSample:
    """A sample, the host's monotonic clock when it arrived, ns, and the device's own clock, us:
    without wraps, and carried on by the host's clock over gaps and restarts."""

    host_ns: int
    device_us: int
    sample: Sample


@dataclass(frozen=True)
class Event:
    """Something that happened between samples: `start`, `gap`, `resumed`, `restart`, `text`; and
    `dropped`, of items that waited too long to be drained, which only `drain` gives."""

    host_ns: int
    kind: str
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ReadoutStatistics:
    """Samples that arrived, that the counter misses, frames that were none, gaps, restarts of the
    read-out board; items that nobody drained in time."""

    samples: int = 0
    lost: int = 0
    bad: int = 0
    gaps: int = 0
    restarts: int = 0
    dropped: int = 0


#: Takes samples and events as soon as they arrive, in their order, in the source's own thread.
Sink = Callable[["StampedSample | Event"], None]


class Source(Protocol):
    """Samples as they come. `start` before the rest, `close` after it; both from one thread. A
    `sink`, set before `start`, gets everything at once: a recording that is to survive its
    program."""

    name: str
    sink: Sink | None

    def start(self) -> Info:
        """Begin; raises CaptureError where there is nothing to read."""

    def drain(self) -> list[StampedSample | Event]:
        """All since the last call, in order, or an event `dropped` and the latest of them; raises
        what ended the source when there is no more: RecordingEnd for the end of a recording."""

    def read_latest(self, max_age: float) -> StampedSample:
        """The newest sample; raises StaleError if it arrived more than `max_age` s ago, and what
        ended the source if something did."""

    @property
    def statistics(self) -> ReadoutStatistics: ...

    def close(self) -> None: ...
