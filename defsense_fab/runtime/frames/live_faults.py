"""Detect cords that fail while the device is in use, and plugs that were swapped."""

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
from .live_frame import Note

#: Kind of fault in which the plugs of two channels are exchanged.
SWAPPED = "swapped"
_SENTENCES = {
    TORN: "{} is open: check whether the cord is torn or its plug disconnected",
    SHORTED: "{} is shorted: check whether its wires touch",
    STUCK: "{} does not change while other channels do: check that its plug is in the right socket",
    LOOSE: "{} jumps from sample to sample: its contact is loose",
    SWAPPED: "{} appear to be swapped: exchange their plugs",
}

_MIN_CORD_OHM = 1.0  # below it the current does not flow through rubber
_SAMPLES_BEYOND_LIMIT = 3  # in a row: one may be a transmission error
_FAULT_HOLD_S = 1.0  # after its last sign a fault is reported for so long
_FAULT_WINDOW_S = 6.0  # of samples in which slow faults are searched
_SEARCH_INTERVAL_S = 0.1

_SWAP_TIME_CONSTANT_S = 4.0  # of the averages of distances that are compared
_SWAP_MIN_DISTANCE = 1.0  # from the training: nearer readings are plausible as they are
_SWAP_MAX_RATIO = 0.45  # of that distance, with the two channels exchanged
_SWAP_SIDE_SAMPLES = 3  # on either side of a swap
_SWAP_JUMP_FACTOR = 1.5  # times the step between samples that is a loose contact
_SWAP_MATCH_TOLERANCE = 0.25  # of that jump, between a value and the other channel's before


def fault_note(channels: Sequence[str], kind: str, indices: Sequence[int]) -> Note:
    """Return the note on a fault.

    Args:
        channels: Names of all channels.
        kind: `TORN`, `SHORTED`, `STUCK`, `LOOSE` or `SWAPPED`; it becomes the note's code.
        indices: Indices of the channels concerned: one, or the two that are swapped.
    """
    names = tuple(channels[i] for i in indices)
    return Note(kind, _SENTENCES[kind].format(" and ".join(names)), {"channels": names})


@dataclass(frozen=True)
class LiveFault:
    """A channel that has failed.

    Attributes:
        channel: Index of the channel.
        kind: `TORN`, `SHORTED`, `STUCK` or `LOOSE`.
        since: Time of its first sign, s.
    """

    channel: int
    kind: str
    since: float


class LiveFaults:
    """Report the faults of channels, sample after sample.

    Open and short circuits show within a few samples. A channel that is stuck, or whose contact is
    loose, takes longer to recognise (`decoding/channel_faults.py`).

    Args:
        limits: Limits learned in the training; None to detect only open and short circuits.
        channels: Number of channels c.
    """

    def __init__(self, limits: FaultLimits | None, channels: int) -> None:
        self._limits, self._count = limits, channels
        self._samples_beyond = np.zeros((2, channels), int)  # the upper, the lower limit
        self._last_ohms, self._same_since = np.full(channels, np.nan), np.zeros(channels)
        self._window: deque[tuple[float, Float]] = deque()
        self._last_search = -np.inf
        self._slow_faults: dict[int, tuple[str, float]] = {}
        self._faults: dict[int, LiveFault] = {}
        self._last_sign: dict[int, float] = {}

    def reset(self) -> None:
        """Forget all samples so far, which came from other channels or another rest."""
        self._samples_beyond[:] = 0
        self._window.clear()
        self._slow_faults, self._faults = {}, {}

    def __call__(self, time: float, ohms: Float, signals: Float) -> list[LiveFault]:
        """Return the present faults, by channel.

        Args:
            time: Time of the sample, s.
            ohms: Resistances (c,), ohm.
            signals: Relative changes (R - R0)/R0 (c,).
        """
        self._window.append((time, signals))
        while time - self._window[0][0] > _FAULT_WINDOW_S:
            self._window.popleft()
        kinds = self._fast_faults(time, ohms, signals)
        if self._limits is not None:
            if time - self._last_search >= _SEARCH_INTERVAL_S:
                self._last_search = time
                self._slow_faults = self._find_slow_faults(self._limits)
            for c, (kind, _) in self._slow_faults.items():
                kinds.setdefault(c, kind)
        for c, kind in kinds.items():
            self._last_sign[c] = time
            if c not in self._faults or self._faults[c].kind != kind:
                since = self._slow_faults[c][1] if c in self._slow_faults else time
                self._faults[c] = LiveFault(c, kind, since)
        for c in [c for c in self._faults if time - self._last_sign[c] > _FAULT_HOLD_S]:
            del self._faults[c]
        return [self._faults[c] for c in sorted(self._faults)]

    def _fast_faults(self, time: float, ohms: Float, signals: Float) -> dict[int, str]:
        too_high, too_low = ~np.isfinite(ohms), ohms < _MIN_CORD_OHM
        if self._limits is not None:
            with np.errstate(invalid="ignore"):
                too_high = too_high | (signals > self._limits.high)
                too_low = too_low | (signals < self._limits.low)
        self._samples_beyond[0] = np.where(too_high & ~too_low, self._samples_beyond[0] + 1, 0)
        self._samples_beyond[1] = np.where(too_low, self._samples_beyond[1] + 1, 0)
        kinds = {}
        for c in range(self._count):
            if self._samples_beyond[0, c] >= _SAMPLES_BEYOND_LIMIT:
                kinds[c] = TORN
            elif self._samples_beyond[1, c] >= _SAMPLES_BEYOND_LIMIT:
                kinds[c] = SHORTED
        for c in np.flatnonzero(self._repeats(time, ohms)).tolist():
            kinds.setdefault(c, STUCK)
        return kinds

    def _repeats(self, time: float, ohms: Float) -> Bool:
        """Return which channels have been exactly the same for longer than noise allows."""
        self._same_since = np.where(ohms == self._last_ohms, self._same_since, time)
        self._last_ohms = ohms
        if self._limits is None or self._limits.repeats is None:
            return np.zeros(self._count, bool)
        return np.asarray(time - self._same_since > self._limits.repeats)

    def _find_slow_faults(self, limits: FaultLimits) -> dict[int, tuple[str, float]]:
        time = np.array([t for t, _ in self._window])
        signals = np.array([s for _, s in self._window])
        if len(time) < 3:
            return {}
        faults = find_faults(limits, time, signals)
        return {f.channel: (f.kind, f.since) for f in faults if f.kind not in (TORN, SHORTED)}


class SwapWatch:
    """Detect two channels whose plugs were swapped.

    A swap during use shows at once: two channels take each other's resistance from one sample to
    the next, each by a jump that hands do not produce. A swap before use shows in seconds: the
    readings lie far from the training, but near it with two channels exchanged.

    Args:
        model: The trained model of the device.

    Attributes:
        pair: Indices of the channels that are swapped now, or None.
    """

    def __init__(self, model: TrainedModel) -> None:
        count = len(model.channels)
        self.pair: tuple[int, int] | None = None
        self._pairs = list(combinations(range(count), 2))
        self._orders = np.array(
            [list(range(count)), *(_swapped_order(count, pair) for pair in self._pairs)]
        )
        # The range of signals alone: after a swap, memories are wrong for a long time in all
        # orders but one.
        self._model, self._range = model, model.main.signal_range
        self._mean_log_distance = np.zeros(len(self._orders))
        self._averaged_since, self._last_time = np.nan, np.nan
        self._window: deque[Float] = deque(maxlen=2 * _SWAP_SIDE_SAMPLES)

    def unswap(self, ohms: Float) -> Float:
        """Return resistances (c,) in the order that they would have without a swap."""
        if self.pair is None:
            return ohms
        return np.asarray(ohms[_swapped_order(len(ohms), self.pair)])

    def __call__(self, time: float, ohms: Float, rest: Float) -> None:
        """Update `pair` by a sample.

        Args:
            time: Time of the sample, s.
            ohms: Resistances (c,) as they were read, ohm.
            rest: Resistances at rest R0 (c,), ohm.
        """
        self._window.append(ohms)
        jumped = self._jumped_pair()
        if jumped is not None:
            self.pair = None if jumped == self.pair else jumped
            self._averaged_since = np.nan
            self._window.clear()
        if not (np.isfinite(ohms) & (ohms > 0)).all():
            self._averaged_since = np.nan
            return
        dt = time - self._last_time if np.isfinite(self._last_time) else 0.0
        self._last_time = time
        signals = self._model.correct(relative_change(ohms[self._orders], rest))
        log_distance = np.log(np.maximum(self._range.distance(signals), 1e-6))
        if not np.isfinite(self._averaged_since):
            self._averaged_since, self._mean_log_distance = time, log_distance
        share = -np.expm1(-dt / _SWAP_TIME_CONSTANT_S)
        self._mean_log_distance += share * (log_distance - self._mean_log_distance)
        if time - self._averaged_since < _SWAP_TIME_CONSTANT_S:
            return
        mean = self._mean_log_distance
        current = 0 if self.pair is None else 1 + self._pairs.index(self.pair)
        best = int(np.argmin(mean))
        is_implausible = mean[current] > np.log(_SWAP_MIN_DISTANCE)
        if is_implausible and mean[best] < mean[current] + np.log(_SWAP_MAX_RATIO):
            self.pair = self._pairs[best - 1] if best else None

    def _jumped_pair(self) -> tuple[int, int] | None:
        """Return the two channels that have just been exchanged, in either direction."""
        limits = self._model.faults
        if limits is None or len(self._window) < 2 * _SWAP_SIDE_SAMPLES:
            return None
        # The sample during which it happens may belong to neither side.
        sides = range(_SWAP_SIDE_SAMPLES - 1), range(_SWAP_SIDE_SAMPLES, 2 * _SWAP_SIDE_SAMPLES)
        before, after = (np.median([self._window[k] for k in side], axis=0) for side in sides)
        good = np.isfinite(before) & np.isfinite(after) & (before > 0) & (after > 0)
        with np.errstate(all="ignore"):
            jumped = good & (np.abs(after / before - 1) > _SWAP_JUMP_FACTOR * limits.jump)
            for a, b in self._pairs:
                if not (jumped[a] and jumped[b]):
                    continue
                tolerance = _SWAP_MATCH_TOLERANCE * np.abs(after - before)
                if (
                    abs(after[a] - before[b]) < tolerance[a]
                    and abs(after[b] - before[a]) < tolerance[b]
                ):
                    return a, b
        return None


def _swapped_order(count: int, pair: tuple[int, int]) -> list[int]:
    order, (a, b) = list(range(count)), pair
    order[a], order[b] = b, a
    return order
