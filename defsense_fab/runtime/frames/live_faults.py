"""Cords that fail while the device is in use: told at once where it can be, and for as long as it
lasts.

An open or short circuit shows in a few samples; that a channel is stuck, or its contact loose,
takes longer to tell (`decoding/channel_faults.py`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...core.arrays import Bool, Float
from ...decoding.channel_faults import LOOSE, SHORTED, STUCK, TORN, FaultLimits, find_faults
from ...decoding.trained_model import TrainedModel
from ...sensing.response import relative_change

# Whether plugs were swapped.
#
# As it happens, two channels take each other's resistance from one sample to the next, each by a jump
# that hands do not make. Otherwise readings lie far from the training, but near it with two channels
# exchanged; that takes seconds to tell.

_TIME = 4.0  # s over which distances are compared
_FAR = 1.0  # distance from the training, above which the readings as they are must lie
_NEARER = 0.45  # of that, below which the exchanged ones must
_AROUND = 3  # samples on either side of a swap
_JUMP = 1.5  # times the steps between samples that are a loose contact, of either channel
_ALIKE = 0.25  # of such a jump, by which the values after a swap differ from the other's before


class SwapWatch:
    """Looks at the resistances of a model's channels, all pairs exchanged in turn. `pair` is the
    one that is exchanged now, by index, None: none is."""

    def __init__(self, model: TrainedModel) -> None:
        count = len(model.channels)
        self.pair: tuple[int, int] | None = None
        self._pairs = list(combinations(range(count), 2))
        self._orders = [list(range(count)), *(_exchanged(count, pair) for pair in self._pairs)]
        # Not of what is remembered: that is wrong of all orders but one, for long after a swap.
        self._model, self._range = model, model.main.range.of_signals()
        self._mean = np.zeros(len(self._orders))
        self._since, self._time = np.nan, np.nan
        self._window: deque[Float] = deque(maxlen=2 * _AROUND)

    def exchanged(self, ohms: Float) -> Float:
        """Resistances (c,) as they would be if nothing was swapped."""
        if self.pair is None:
            return ohms
        return np.asarray(ohms[_exchanged(len(ohms), self.pair)])

    def __call__(self, time: float, ohms: Float, rest: Float) -> None:
        """Of resistances (c,) ohm with R0 (c,) ohm, at a time, s."""
        self._window.append(ohms)
        jumped = self._at_once()
        if jumped is not None:
            self.pair = None if jumped == self.pair else jumped
            self._since = np.nan
            self._window.clear()
        if not (np.isfinite(ohms) & (ohms > 0)).all():
            self._since = np.nan
            return
        dt = time - self._time if np.isfinite(self._time) else 0.0
        self._time = time
        signals = np.array(
            [self._model.corrected(relative_change(ohms[o], rest)) for o in self._orders]
        )
        now = np.log(np.maximum(self._range.distance(signals), 1e-6))
        if not np.isfinite(self._since):
            self._since, self._mean = time, now
        self._mean += -np.expm1(-dt / _TIME) * (now - self._mean)
        if time - self._since < _TIME:
            return
        current = 0 if self.pair is None else 1 + self._pairs.index(self.pair)
        best = int(np.argmin(self._mean))
        far = self._mean[current] > np.log(_FAR)
        if far and self._mean[best] < self._mean[current] + np.log(_NEARER):
            self.pair = self._pairs[best - 1] if best else None

    def _at_once(self) -> tuple[int, int] | None:
        """The two that have just been exchanged, or back."""
        limits = self._model.faults
        if limits is None or len(self._window) < 2 * _AROUND:
            return None
        # The sample in which it happens may lie on neither side.
        before = np.median([self._window[k] for k in range(_AROUND - 1)], axis=0)
        after = np.median([self._window[k] for k in range(_AROUND, 2 * _AROUND)], axis=0)
        good = np.isfinite(before) & np.isfinite(after) & (before > 0) & (after > 0)
        with np.errstate(all="ignore"):
            jumped = good & (np.abs(after / before - 1) > _JUMP * limits.jump)
            for a, b in self._pairs:
                if not (jumped[a] and jumped[b]):
                    continue
                near_a = abs(after[a] - before[b]) < _ALIKE * abs(after[a] - before[a])
                near_b = abs(after[b] - before[a]) < _ALIKE * abs(after[b] - before[b])
                if near_a and near_b:
                    return a, b
        return None


def _exchanged(count: int, pair: tuple[int, int]) -> list[int]:
    order, (a, b) = list(range(count)), pair
    order[a], order[b] = b, a
    return order


# What is said of a cord that fails.

SWAPPED = "swapped"
_WORDS = {
    TORN: "{} is open: is the cord torn, or its plug out?",
    SHORTED: "{} is shorted: do its wires touch?",
    STUCK: "{} does not change while others do: is its plug in the right place?",
    LOOSE: "{} jumps from sample to sample: its contact is loose",
    SWAPPED: "{} look swapped: exchange their plugs",
}


def fault_told(names: Sequence[str], kind: str, channels: Sequence[int]) -> str:
    """A sentence on channels by index."""
    return _WORDS[kind].format(" and ".join(names[c] for c in channels))


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
