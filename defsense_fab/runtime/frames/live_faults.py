"""Cords that fail while the device is in use: told at once where it can be, and for as long as it
lasts.

An open or short circuit shows in a few samples; that a channel is stuck, or its contact loose,
takes longer to tell (`decoding/channel_faults.py`).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from ...decoding.channel_faults import SHORTED, STUCK, TORN, FaultLimits, find_faults

_WIRE = 1.0  # ohm, of what is no rubber
_SURE = 3  # samples in a row beyond a limit: one may be a glitch of the line
_GONE = 1.0  # s without it, after which a fault is over
_WINDOW = 6.0  # s that slow faults are looked for in
_EVERY = 0.1  # s


@dataclass(frozen=True)
class LiveFault:
    """The `channel` (by index) that is wrong, how, and since when, s."""

    channel: int
    kind: str
    since: float


class LiveFaults:
    """Faults of channels by the limits of a training; None: none are looked for but open and short
    circuits."""

    def __init__(self, limits: FaultLimits | None, channels: int) -> None:
        self._limits, self._count = limits, channels
        self._beyond = np.zeros((2, channels), int)
        self._last, self._same_since = np.full(channels, np.nan), np.zeros(channels)
        self._window: deque[tuple[float, Float]] = deque()
        self._looked = -np.inf
        self._slow: dict[int, tuple[str, float]] = {}
        self._now: dict[int, LiveFault] = {}
        self._last_seen: dict[int, float] = {}

    def begin_anew(self) -> None:
        """Forget the samples so far: they were of other channels."""
        self._beyond[:] = 0
        self._window.clear()
        self._slow, self._now = {}, {}

    def __call__(self, time: float, ohms: Float, signals: Float) -> list[LiveFault]:
        """Of a sample: resistances (c,) ohm, and (R - R0)/R0 (c,), at a time, s."""
        self._window.append((time, signals))
        while time - self._window[0][0] > _WINDOW:
            self._window.popleft()
        seen = self._at_once(time, ohms, signals)
        if self._limits is not None:
            if time - self._looked >= _EVERY:
                self._looked = time
                self._slow = self._slowly()
            for c, (kind, _) in self._slow.items():
                seen.setdefault(c, kind)
        for c, kind in seen.items():
            self._last_seen[c] = time
            if c not in self._now or self._now[c].kind != kind:
                since = self._slow[c][1] if c in self._slow else time
                self._now[c] = LiveFault(c, kind, since)
        for c in [c for c in self._now if time - self._last_seen[c] > _GONE]:
            del self._now[c]
        return [self._now[c] for c in sorted(self._now)]

    def _at_once(self, time: float, ohms: Float, signals: Float) -> dict[int, str]:
        high, low = ~np.isfinite(ohms), ohms < _WIRE
        if self._limits is not None:
            with np.errstate(invalid="ignore"):
                high = high | (signals > self._limits.high)
                low = low | (signals < self._limits.low)
        self._beyond[0] = np.where(high & ~low, self._beyond[0] + 1, 0)
        self._beyond[1] = np.where(low, self._beyond[1] + 1, 0)
        found = {}
        for c in range(self._count):
            if self._beyond[0, c] >= _SURE:
                found[c] = TORN
            elif self._beyond[1, c] >= _SURE:
                found[c] = SHORTED
        for c in np.flatnonzero(self._repeating(time, ohms)).tolist():
            found.setdefault(c, STUCK)
        return found

    def _repeating(self, time: float, ohms: Float) -> Bool:
        """Channels that have been the same for longer than noise allows."""
        self._same_since = np.where(ohms == self._last, self._same_since, time)
        self._last = ohms
        if self._limits is None or self._limits.repeats is None:
            return np.zeros(self._count, bool)
        return np.asarray(time - self._same_since > self._limits.repeats)

    def _slowly(self) -> dict[int, tuple[str, float]]:
        assert self._limits is not None
        time = np.array([t for t, _ in self._window])
        signals = np.array([s for _, s in self._window])
        if len(time) < 3:
            return {}
        found = find_faults(self._limits, time, signals)
        return {f.channel: (f.kind, f.since) for f in found if f.kind not in (TORN, SHORTED)}
