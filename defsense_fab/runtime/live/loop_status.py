"""The state of a live loop: its newest frame, its rates and latencies, and notes on events."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass

import numpy as np

from ...capture.readout.source import Event, NetworkStatistics, ReadoutStatistics
from ...core.arrays import Float
from ..frames.fixed_decoder import target_values
from ..frames.live_frame import LiveFrame, Note

_MAX_LATENCIES = 6000  # a minute at 100 Hz
_RATE_WINDOW_S = 3.0
_LOSS_WINDOW_S = 10.0
#: Share of the samples, and number of them, that may be lost in that time without a note.
_MAX_LINE_LOSS, _MAX_LOST_SAMPLES = 0.01, 4


@dataclass(frozen=True)
class LiveStatus:
    """The state of a loop.

    Attributes:
        frame: The newest frame, or None.
        rate: Decoded frames per second.
        surface_rate: Surfaces per second.
        output_latency: Median and 99th percentile of the time from a sample's arrival until its
            frame was given to the outputs, s; NaN before the first frame.
        view_latency: The same until its surface was given to the views.
        samples: Number of samples that have arrived.
        skipped: Number of samples that arrived but were not decoded: the computer was too slow, or
            they do not fit the device.
        lost: Number of samples that did not arrive, or arrived damaged, by the board's counter.
        notes: Notes on all parts of the loop.
        network: Counts of packets and times of a board with Wi-Fi; None for other sources.
    """

    frame: LiveFrame | None
    rate: float
    surface_rate: float
    output_latency: tuple[float, float]
    view_latency: tuple[float, float]
    samples: int
    skipped: int
    lost: int
    notes: tuple[Note, ...]
    network: NetworkStatistics | None = None

    @property
    def targets(self) -> dict[str, dict[str, object]]:
        """The newest targets of a sensor that is no device, in plain values; else empty."""
        return {} if self.frame is None else target_values(self.frame)


class Latency:
    """Latencies of the last minute."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, float]] = deque(maxlen=_MAX_LATENCIES)

    def add(self, seconds: float) -> None:
        """Add the latency of a frame, s."""
        self._rows.append((time.monotonic(), seconds))

    @property
    def values(self) -> Float:
        """The latencies (n,), s."""
        return np.array([s for _, s in tuple(self._rows)])

    @property
    def quantiles(self) -> tuple[float, float]:
        """Median and 99th percentile, s; NaN without values."""
        values = self.values
        if not len(values):
            return float("nan"), float("nan")
        return float(np.median(values)), float(np.quantile(values, 0.99))

    @property
    def rate(self) -> float:
        """Values per second, over the last three seconds."""
        now = time.monotonic()
        recent = [t for t, _ in tuple(self._rows) if t > now - _RATE_WINDOW_S]
        return len(recent) / _RATE_WINDOW_S


class LineLoss:
    """Samples that were lost on the line within the last ten seconds."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, int, int]] = deque()
        self._has_network = False

    def add(self, now: float, statistics: ReadoutStatistics) -> None:
        """Add the counts of the source at a time, s."""
        self._rows.append((now, statistics.samples, statistics.lost))
        self._has_network = statistics.network is not None
        while self._rows[0][0] < now - _LOSS_WINDOW_S:
            self._rows.popleft()

    def restart(self) -> None:
        """Forget the counts, because samples of a disconnected board are not lost on the line."""
        self._rows.clear()

    def note(self, source: str) -> Note | None:
        """Return a note on the source if too many samples were lost; None if not."""
        rows = tuple(self._rows)
        if not rows:
            return None
        arrived, lost = rows[-1][1] - rows[0][1], rows[-1][2] - rows[0][2]
        share = lost / max(arrived + lost, 1)
        if lost <= _MAX_LOST_SAMPLES or share <= _MAX_LINE_LOSS:
            return None
        place, remedy = "on the line", "check the cable"
        if self._has_network:
            place, remedy = "in the network", "move the board nearer to the access point"
        text = f"{source}: {100 * share:.0f} % of the samples were lost {place}: {remedy}"
        return Note("samples-lost", text, {"share": share, "lost": lost})


def event_note(source: str, event: Event) -> Note | None:
    """Return a note on an event of the read-out board; None if users need not know it.

    Args:
        source: Name of the source.
        event: The event.
    """
    if event.kind == "gap":
        reason = event.data.get("why", "no answer")
        text = f"{source}: the read-out board is disconnected ({reason}); waiting for it"
        return Note("board-disconnected", text, {"reason": reason})
    if event.kind == "resumed":
        return Note("board-reconnected", f"{source}: the read-out board is connected again")
    if event.kind == "restart":
        return Note("board-restarted", f"{source}: the read-out board has restarted")
    if event.kind == "bad-line":
        text = (
            f"{source}: {event.data['count']} lines are no samples, such as"
            f" {event.data['line']!r}; send a number for each column"
        )
        return Note("bad-line", text, event.data)
    return None
