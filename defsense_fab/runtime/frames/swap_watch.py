"""Whether plugs were swapped: readings that lie far from the training, but near it with two
channels exchanged."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ...core.arrays import Float
from ...decoding.past import PastStream
from ...decoding.trained_model import TrainedModel

_TIME = 4.0  # s over which distances are compared
_FAR = 1.0  # distance from the training, above which the readings as they are must lie
_NEARER = 0.45  # of that, below which the exchanged ones must


class SwapWatch:
    """Looks at the corrected signals of a model's channels, all pairs exchanged in turn."""

    def __init__(self, model: TrainedModel) -> None:
        count = len(model.channels)
        orders = [list(range(count))]
        self.pairs = list(combinations(range(count), 2))
        for a, b in self.pairs:
            order = list(range(count))
            order[a], order[b] = b, a
            orders.append(order)
        self._orders = orders
        self._branch = model.main
        self._pasts = [PastStream(model.main.past, count) for _ in orders]
        self._mean = np.full(len(orders), np.nan)
        self._since, self._time = np.nan, np.nan

    def __call__(self, time: float, signals: Float) -> tuple[int, int] | None:
        """The pair that is exchanged, by the signals (c,) up to a time, s."""
        if not np.isfinite(signals).all():
            self._since = np.nan
            return None
        dt = time - self._time if np.isfinite(self._time) else 0.0
        self._time = time
        z = np.array([p(time, signals[o]) if self._branch.past.count else signals[o]
                      for p, o in zip(self._pasts, self._orders, strict=True)])  # fmt: skip
        now = np.log(np.maximum(self._branch.range.distance(z), 1e-6))
        if not np.isfinite(self._since):
            self._since, self._mean = time, now
        keep = np.exp(-dt / _TIME)
        self._mean = keep * self._mean + (1 - keep) * now
        if time - self._since < _TIME or self._mean[0] < np.log(_FAR):
            return None
        best = int(np.argmin(self._mean[1:]))
        if self._mean[1 + best] < self._mean[0] + np.log(_NEARER):
            return self.pairs[best]
        return None
