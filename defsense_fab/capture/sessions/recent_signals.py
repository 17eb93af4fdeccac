"""The signals of the last seconds of a recording, relative to its last rest."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...core.guided_parts import Bars, Curve, Part, Plot
from ...sensing.response import relative_change
from ...sensing.voltage_divider import Dividers
from ..readout.source import Source, StampedSample

MAX_SAMPLE_AGE_S = 1.5  # before the read-out board is reported as silent
REST_SHARE = 0.8  # last part of a rest, from which rest resistances are measured
TRACE_DURATION_S, MAX_TRACE_POINTS = 20.0, 240
_MIN_TRACE_RANGE, _FULL_BAR_CHANGE = 0.02, 0.2  # of (R - R0)/R0


class RecentSignals:
    """Samples of the last seconds, relative to the last rest.

    Args:
        channels: Names of the channels (c,).
        reference: Reference resistors (c,), ohm.

    Attributes:
        count: Number of samples so far.
    """

    def __init__(self, channels: Sequence[str], reference: Sequence[float]) -> None:
        self._channels, self._reference = tuple(channels), np.array(reference)
        self._dividers: Dividers | None = None
        self._time: list[float] = []
        self._ohm: list[Float] = []
        self._rest: Float | None = None
        self._rest_samples: list[Float] | None = None  # None outside of a rest
        self._received_at: float | None = None
        self.count = 0

    def set_full_scale(self, full_scale: float) -> None:
        """Set the full scale of the read-out board's counts."""
        self._dividers = Dividers(self._reference, full_scale)

    def start_rest(self) -> None:
        """Measure the rest resistances from now on."""
        self._rest_samples = []

    def end_rest(self) -> None:
        """Keep the rest resistances."""
        self._rest_samples = None

    def is_silent(self) -> bool:
        """Return whether samples have ceased to arrive."""
        now = time.monotonic()
        return self._received_at is not None and now - self._received_at > MAX_SAMPLE_AGE_S

    def add(self, board: Source) -> None:
        """Add the samples that have arrived."""
        assert self._dividers is not None  # the board is open
        for item in board.drain():
            if not isinstance(item, StampedSample):
                continue
            self.count += 1
            self._received_at = time.monotonic()
            ohm = self._dividers.resistance(item.sample.counts)
            self._time.append(item.host_ns / 1e9)
            self._ohm.append(ohm)
            if self._rest_samples is not None:
                self._rest_samples.append(ohm)
        if self._time:
            first = np.searchsorted(self._time, self._time[-1] - TRACE_DURATION_S)
            del self._time[:first], self._ohm[:first]
        if self._rest_samples:
            late = self._rest_samples[int((1 - REST_SHARE) * len(self._rest_samples)) :]
            self._rest = np.median(np.array(late), axis=0)

    def parts(self) -> list[Part]:
        """Return bars of the newest changes (R - R0)/R0, and their trace over time."""
        if not self._channels:
            return []
        names, count = self._channels, len(self._channels)
        if not self._time:
            return [Bars(np.zeros((count, 1)), names, ("-",) * count, has_colors=True)]
        ohm = np.array(self._ohm)
        # A resumed session has no rest before its next step at rest.
        rest = np.median(ohm, axis=0) if self._rest is None else self._rest
        with np.errstate(invalid="ignore"):
            changes = relative_change(ohm, rest)
        now = changes[-1]
        values = np.where(np.isfinite(now), np.minimum(np.abs(now) / _FULL_BAR_CHANGE, 1.0), 0.0)
        texts = tuple(f"{c:+.2%}" if np.isfinite(c) else "-" for c in now)
        bars = Bars(values[:, None], names, texts, has_colors=True)
        stride = -(-len(ohm) // MAX_TRACE_POINTS)
        times, changes = np.array(self._time)[::stride] - self._time[-1], changes[::stride]
        largest = np.abs(changes[np.isfinite(changes)]).max(initial=0.0)
        y = max(float(largest), _MIN_TRACE_RANGE)
        curves = tuple(
            Curve(name, times, changes[:, k], k, is_line=True) for k, name in enumerate(names)
        )
        title = f"(R - R0)/R0 (+-{y:.1%}), last {TRACE_DURATION_S:.0f} s"
        return [bars, Plot(title, curves, (-TRACE_DURATION_S, 0.0), (-y, y), aspect=0.17)]
