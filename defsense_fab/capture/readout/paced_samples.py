"""Samples that are known beforehand, given out as they fall due: what sources that play have in
common."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ...core.arrays import Int
from ...core.errors import CaptureError
from ...sensing.serial_frames import Sample
from .source import Event, ReadoutStatistics, RecordingEnd, Sink, StaleError, StampedSample


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
