"""Whether plugs were swapped.

As it happens, two channels take each other's resistance from one sample to the next, each by a jump
that hands do not make. Otherwise readings lie far from the training, but near it with two channels
exchanged; that takes seconds to tell.
"""

from __future__ import annotations

from collections import deque
from itertools import combinations

import numpy as np

from ...core.arrays import Float
from ...decoding.trained_model import TrainedModel
from ...sensing.signal import relative_change

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
