"""The resistances at rest, R0, that live signals refer to: measured first, and followed as cords
drift.

Rubber cords drift by per cents in hours, more than some poses change them, and set in the first
cycles after a long rest (the Mullins effect). What that changes is known where the training began
with a rest, too, and is taken into account from the beginning. What a device says while it lies
still near its rest is its rest: R0 is the mean of the last half minute of that, and a hand that
stops in the middle of a pose for a moment counts no more than it lasts.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

_WINDOW = 1.5  # s in which a device that rests hardly changes
_STILL = 0.04  # of what a channel spans in training, between the means of parts of that time
_PARTS = 5
_NEAR = 0.15  # of that span: farther away it is no rest
_MOVED = 0.4  # of that span: a device that went so far has been moved
_KNOWN = 5.0  # s of rest, for which a rest counts that was known before the device was moved
_SHORTEST, _LONGEST = 0.5, 30.0  # s of rest that R0 is the mean of
_SETTLED = 2.0  # s of rest after movement, after which it has been set anew
_DRIFTED = 0.01  # relative change of R0 that is told
_LEAST = 15  # samples


@dataclass(frozen=True)
class Rest:
    """R0 (c,) ohm, None until it was measured; whether the device rests now; whether it has rested
    after it was moved, so that its cords have set; by how much R0 has changed (c,) since, relative.
    """

    ohms: Float | None
    resting: bool
    settled: bool
    drift: Float


class RestTracker:
    """Of channels that span `span` (c,) of (R - R0)/R0 in training. `ohms` (c,): R0 where it is
    known; otherwise it is the median of the first time that nothing changes, in which signals are
    `lying` (c,), where the training tells what they are before cords have set."""

    def __init__(self, span: Float, ohms: Float | None = None, lying: Float | None = None) -> None:
        self._span = np.maximum(span, 1e-6)
        self._first = self._now = None if ohms is None else np.asarray(ohms, float)
        self._set = np.ones(len(span)) if lying is None else 1 / (1 + np.asarray(lying, float))
        self._window: deque[tuple[float, Float]] = deque()
        self._checked, self._resting = -np.inf, False
        self._moved = self._settled = ohms is not None
        self._known = _KNOWN if lying is not None or ohms is not None else 0.0
        self._mean_of = self._known  # s of rest
        self._rested = 0.0  # s since it was moved

    def __call__(self, time: float, ohms: Float, lost: frozenset[int] = frozenset()) -> Rest:
        """Of the sample (c,) ohm at a time, s, later than the one before; channels in `lost` say
        nothing."""
        if self._window and time - self._window[-1][0] > _WINDOW:
            self._window.clear()
        self._window.append((time, ohms))
        while time - self._window[0][0] > _WINDOW:
            self._window.popleft()
        if time - self._checked >= 0.1:
            self._look(time - self._checked, lost)
            self._checked = time
        return self._told()

    def set_now(self) -> None:
        """Take the readings of the last moment for those at rest."""
        R = np.array([ohms for _, ohms in self._window])
        if len(R) and np.isfinite(R).all() and (R > 0).all():
            self._first = self._now = np.median(R[-_LEAST:], axis=0)
            self._moved = self._settled = True
            self._mean_of = _KNOWN

    def _told(self) -> Rest:
        if self._first is None or self._now is None:
            return Rest(None, self._resting, False, np.zeros(len(self._span)))
        return Rest(self._now, self._resting, self._settled, self._now / self._first - 1)

    def _look(self, since: float, lost: frozenset[int]) -> None:
        time = self._window[-1][0] - self._window[0][0]
        good = [c for c in range(len(self._span)) if c not in lost]
        self._resting = False
        if time < 0.8 * _WINDOW or len(self._window) < _LEAST or not good:
            return
        R = np.array([ohms for _, ohms in self._window])[:, good]
        if not np.isfinite(R).all() or (R <= 0).any():
            return
        middle = np.median(R, axis=0)
        if self._now is not None and not self._moved:
            away = np.abs(middle / self._now[good] - 1)
            if (away > _MOVED * self._span[good]).any():
                self._moved, self._mean_of = True, self._known
        means = np.array([part.mean(axis=0) for part in np.array_split(R, _PARTS)])
        if (np.ptp(means, axis=0) / middle > _STILL * self._span[good]).any():
            return
        middle = middle if self._moved else middle * self._set[good]
        if self._now is None:
            if len(good) == len(self._span):
                self._first = self._now = middle
                self._resting = True
            return
        if (np.abs(middle / self._now[good] - 1) > _NEAR * self._span[good]).any():
            return
        self._resting = True
        self._follow(middle, good, min(since, 0.2))

    def _follow(self, middle: Float, good: list[int], since: float) -> None:
        """The mean of rests goes on by the readings `middle` of channels that are `good`."""
        assert self._now is not None
        self._mean_of = min(self._mean_of + since, _LONGEST)
        now = self._now.copy()
        now[good] += since / max(self._mean_of, _SHORTEST) * (middle - now[good])
        self._now = now
        self._rested += since if self._moved else 0.0
        if self._rested > _SETTLED and not self._settled:
            self._first, self._settled = now, True


def drift_told(names: tuple[str, ...], drift: Float) -> str | None:
    """A sentence of cords that have drifted, None where none has by 1 %."""
    far = [
        f"{name} by {100 * d:+.1f} %"
        for name, d in zip(names, drift, strict=True)
        if abs(d) >= _DRIFTED
    ]
    return f"drift of the rest reading is taken out: {', '.join(far)}" if far else None
