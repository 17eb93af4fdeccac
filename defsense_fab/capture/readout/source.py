"""Sources of samples: the interface that ports, sockets, recordings and twins share."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ...core.arrays import Int
from ...core.errors import CaptureError
from ...sensing.serial_frames import Info, Sample


class StaleError(CaptureError):
    """No reading is recent enough."""


class RecordingEnd(CaptureError):
    """The recording that is played back has ended, as it should."""


@dataclass(frozen=True)
class StampedSample:
    """A sample with the times of both clocks.

    Attributes:
        host_ns: The host's monotonic clock when the sample arrived, ns.
        device_us: The device's own clock, us. It does not wrap; over gaps and restarts the host's
            clock carries it on.
        sample: The sample as the read-out board sent it.
    """

    host_ns: int
    device_us: int
    sample: Sample


@dataclass(frozen=True)
class Event:
    """Something that happened between samples.

    Attributes:
        host_ns: The host's monotonic clock, ns.
        kind: `start`, `gap`, `resumed`, `restart`, `text`, `info`, `bad-line`, or a step of a
            protocol.
            `dropped` stands for items that waited too long to be drained; only `drain` returns it.
        data: Facts about the event, as plain values.
    """

    host_ns: int
    kind: str
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class NetworkStatistics:
    """Counts of the packets of a board that is read over a network.

    Attributes:
        reordered: Packets that arrived behind a later one and were put back into order.
        duplicates: Packets that arrived again.
        late: Packets that arrived too late to be put back into order; their samples are lost.
        rejected: Packets with a wrong tag, of another session, replayed, or malformed.
        round_trips: Times from a ping to its answer, s; of the last ten minutes.
    """

    reordered: int
    duplicates: int
    late: int
    rejected: int
    round_trips: tuple[float, ...]

    @property
    def round_trip_ms(self) -> tuple[float, float] | None:
        """Median and 99th percentile of the round trips, ms; None before the first answer."""
        if not self.round_trips:
            return None
        median, high = 1e3 * np.quantile(self.round_trips, (0.5, 0.99))
        return float(median), float(high)

    @property
    def summary(self) -> str:
        """The latency and the counts that are not zero, such as `network 4.1 ms, 2 late packets`.

        The network's latency is half of the round trip: it estimates the time from the board to
        the host, and includes what the board needs to answer.
        """
        times = self.round_trip_ms
        parts = ["network"]
        if times is not None:
            parts = [f"network {times[0] / 2:.1f} ms (99 %: {times[1] / 2:.1f})"]
        names = ("reordered", "duplicates", "late", "rejected")
        counts = [f"{n} {name}" for name in names if (n := getattr(self, name))]
        return ", ".join(parts) + (f"; packets: {', '.join(counts)}" if counts else "")

    def data(self) -> dict[str, object]:
        """Return the counts and times as plain values; see `summary` for the latency."""
        median, high = self.round_trip_ms or (None, None)
        return {
            "reordered": self.reordered,
            "duplicates": self.duplicates,
            "late": self.late,
            "rejected": self.rejected,
            "round_trip_ms": median,
            "round_trip_99_ms": high,
            "network_latency_ms": None if median is None else median / 2,
        }


@dataclass(frozen=True)
class ReadoutStatistics:
    """Counts of what a source has received and lost.

    Attributes:
        samples: Samples that arrived.
        lost: Samples that the counter shows as missing.
        bad: Frames that could not be decoded.
        gaps: Interruptions of the connection.
        restarts: Restarts of the read-out board.
        dropped: Items that were not drained in time.
        network: Counts of packets; None for sources that are not read over a network.
    """

    samples: int = 0
    lost: int = 0
    bad: int = 0
    gaps: int = 0
    restarts: int = 0
    dropped: int = 0
    network: NetworkStatistics | None = None

    def data(self) -> dict[str, object]:
        """Return the counts as plain values; `network` only for boards that have them."""
        counts = {name: value for name, value in vars(self).items() if name != "network"}
        return counts if self.network is None else {**counts, "network": self.network.data()}


#: Receives samples and events as soon as they arrive, in order, in the source's own thread.
Sink = Callable[["StampedSample | Event"], None]


class Source(Protocol):
    """A source of samples.

    Call `start` first and `close` last, both from one thread. A `sink` that is set before `start`
    receives everything at once, so a recording survives a crash of its program.

    Attributes:
        name: Name of the source in messages, such as its port.
        sink: Receiver of all samples and events; None for none.
    """

    name: str
    sink: Sink | None

    def start(self) -> Info:
        """Start reading.

        Returns:
            The description that the read-out board gives of itself.

        Raises:
            CaptureError: If there is nothing to read.
        """

    def drain(self) -> list[StampedSample | Event]:
        """Return everything since the last call, in order.

        If items were dropped, an event `dropped` comes first.

        Raises:
            RecordingEnd: If a recording has ended and nothing is left.
            DefsenseError: The error that ended the source, if nothing is left.
        """

    def read_latest(self, max_age: float) -> StampedSample:
        """Return the newest sample.

        Args:
            max_age: Largest age of the sample, s.

        Raises:
            StaleError: If the newest sample is older than `max_age`.
            DefsenseError: The error that ended the source, if one did.
        """

    @property
    def statistics(self) -> ReadoutStatistics:
        """Counts of received and lost items."""
        ...

    def close(self) -> None:
        """Stop reading and release the source."""
        ...


class PacedSamples:
    """Base of sources that play known samples back at their own pace.

    A subclass adds `start`, which calls `_play`.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.sink: Sink | None = None
        self._latest: StampedSample | None = None
        self._sample: Callable[[int], tuple[int, Sample]] | None = None
        self._due, self._next = np.zeros(0, np.int64), 0

    def _play(self, delays_ns: Int, sample: Callable[[int], tuple[int, Sample]]) -> None:
        """Play samples from now on.

        Args:
            delays_ns: Times (n,) at which samples fall due, ns from now, increasing.
            sample: Returns the device's time, us, and the sample for an index.
        """
        self._due, self._next = time.monotonic_ns() + np.asarray(delays_ns, np.int64), 0
        self._sample = sample

    def drain(self) -> list[StampedSample | Event]:
        """Return the samples that have fallen due since the last call.

        Raises:
            RecordingEnd: After the last sample.
            CaptureError: If playback has not been started.
        """
        if self._sample is None:
            raise CaptureError(
                "is not playing", code="source-not-started", where=self.name, action="Call start()"
            )
        if self._next >= len(self._due):
            raise RecordingEnd("the recording has ended", code="recording-ended", where=self.name)
        end = int(np.searchsorted(self._due, time.monotonic_ns(), side="right"))
        items: list[StampedSample | Event] = []
        for k in range(self._next, end):
            device_us, sample = self._sample(k)
            self._latest = StampedSample(int(self._due[k]), device_us, sample)
            if self.sink is not None:
                self.sink(self._latest)
            items.append(self._latest)
        self._next = max(self._next, end)
        return items

    def read_latest(self, max_age: float) -> StampedSample:
        """Return the newest sample that was drained.

        Args:
            max_age: Largest age of the sample, s.

        Raises:
            StaleError: If there is no sample, or it is older than `max_age`.
        """
        if self._latest is None or time.monotonic_ns() - self._latest.host_ns > max_age * 1e9:
            raise StaleError(
                f"no sample arrived within the last {max_age:g} s",
                code="reading-stale",
                where=self.name,
                action="Call drain(), which plays the recording",
            )
        return self._latest

    @property
    def statistics(self) -> ReadoutStatistics:
        """Counts of the samples that were returned."""
        return ReadoutStatistics(samples=self._next)

    def close(self) -> None:
        """Stop playing."""
        self._sample = None
