"""What every source of samples can do: a port, a socket, a replayed file, a twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from ...core.errors import CaptureError
from ...sensing.serial_frames import Info, Sample


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
