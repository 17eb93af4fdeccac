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

from ...core.arrays import Bool, Float

_WINDOW = 1.5  # s in which a device that rests hardly changes
_STILL = 0.04  # of what a channel spans in training, between the means of parts of that time
_PARTS = 5
_NEAR = 0.15  # of that span: farther away it is no rest
_MOVED = 0.4  # of that span: a device that went so far has been moved
_KNOWN = 5.0  # s of rest, for which a rest counts that was known before the device was moved
_SHORTEST, _LONGEST = 0.5, 30.0  # s of rest that R0 is the mean of
_SETTLED = 2.0  # s of rest after movement, after which it has been set anew
_FARTHEST = 0.3  # of that span, by which R0 may be followed: farther away it is a pose
_DRIFTED = 0.01  # relative change of R0 that is told
_LEAST = 10  # samples


@dataclass(frozen=True)
class Rest:
    """R0 (c,) ohm, None until it was measured, NaN of a channel that never could be; whether the
    device lies `still` now, and whether that is its rest; whether it has rested after it was moved,
    so that its cords have set; by how much R0 has changed (c,) since, relative; whether that is as
    far as it is followed."""

    ohms: Float | None
    still: bool
    resting: bool
    settled: bool
    drift: Float
    farthest: bool


class RestTracker:
    """Of channels that span `span` (c,) of (R - R0)/R0 in training. `ohms` (c,): R0 where it is
    known; otherwise it is the median of the first time that nothing changes, in which signals are
    `lying` (c,), where the training tells what they are before cords have set. `trained` (c,) ohm
    is R0 in training, by which that of a channel is guessed while it cannot be measured."""

    def __init__(
        self, span: Float, ohms: Float | None = None, lying: Float | None = None,
        trained: Float | None = None,
    ) -> None:  # fmt: skip
        c = len(span)
        self._span, self._trained = np.maximum(span, 1e-6), trained
        self._first = self._now = None if ohms is None else np.asarray(ohms, float)
        self._set = np.ones(c) if lying is None else 1 / (1 + np.asarray(lying, float))
        self._guessed = np.zeros(c, bool)  # channels whose R0 was not measured yet
        self._window: deque[tuple[float, Float]] = deque()
        self._checked, self._still, self._resting = -np.inf, False, False
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
        return self.told

    def set_now(self, lost: frozenset[int] = frozenset()) -> bool:
        """Take the readings of the last moment for those at rest; whether there were any."""
        good = self._good(lost)
        R = np.array([ohms for _, ohms in self._window][-_LEAST:]).reshape(-1, len(self._span))
        good &= np.isfinite(R).all(axis=0) & (R > 0).all(axis=0)
        if not len(R) or not good.any():
            return False
        self._begin(good, np.median(R[:, good], axis=0))
        self._moved = self._settled = True
        self._mean_of = _KNOWN
        return True

    @property
    def told(self) -> Rest:
        if self._first is None or self._now is None:
            none = np.zeros(len(self._span))
            return Rest(None, self._still, self._resting, False, none, False)
        drift = np.nan_to_num(self._now / self._first - 1)
        farthest = bool((np.abs(drift) >= 0.999 * _FARTHEST * self._span).any())
        return Rest(self._now, self._still, self._resting, self._settled, drift, farthest)

    def _good(self, lost: frozenset[int]) -> Bool:
        return np.array([c not in lost for c in range(len(self._span))])

    def _look(self, since: float, lost: frozenset[int]) -> None:
        time = self._window[-1][0] - self._window[0][0]
        good = self._good(lost)
        self._still = self._resting = False
        if time < 0.8 * _WINDOW or len(self._window) < _LEAST or not good.any():
            return
        R = np.array([ohms for _, ohms in self._window])[:, good]
        if not np.isfinite(R).all() or (R <= 0).any():
            return
        middle = np.median(R, axis=0)
        if self._now is not None and not self._moved and self._away(good, middle) > _MOVED:
            self._moved, self._mean_of = True, self._known
        means = np.array([part.mean(axis=0) for part in np.array_split(R, _PARTS)])
        if (np.ptp(means, axis=0) / middle > _STILL * self._span[good]).any():
            return
        self._still = True
        middle = middle if self._moved else middle * self._set[good]
        if self._now is None:
            self._begin(good, middle)
            self._resting = True
        elif self._away(good, middle) <= _NEAR:
            self._resting = True
            self._follow(good, middle, min(since, 0.2))

    def _away(self, good: Bool, middle: Float) -> float:
        """How far readings of the `good` channels are from R0, at most, in terms of their spans;
        infinite where no R0 was measured."""
        assert self._now is not None
        measured = ~self._guessed[good]
        if not measured.any():
            return float("inf")
        away = np.abs(middle / self._now[good] - 1) / self._span[good]
        return float(away[measured].max())

    def _begin(self, good: Bool, middle: Float) -> None:
        """R0 is what `good` channels read; of others it stays as it is, or is guessed."""
        now = self._guess(good, middle) if self._now is None else self._now.copy()
        self._guessed = (self._guessed | (self._now is None)) & ~good
        now[good] = middle
        self._first = self._now = now

    def _guess(self, good: Bool, middle: Float) -> Float:
        if self._trained is None:
            return np.full(len(self._span), np.nan)
        return np.asarray(self._trained * np.median(middle / self._trained[good]))

    def _follow(self, good: Bool, middle: Float, since: float) -> None:
        """The mean of rests goes on by the readings `middle` of channels that are `good`."""
        assert self._now is not None
        assert self._first is not None
        self._mean_of = min(self._mean_of + since, _LONGEST)
        now, first = self._now.copy(), self._first.copy()
        now[good] += since / max(self._mean_of, _SHORTEST) * (middle - now[good])
        late = self._guessed & good  # measured now for the first time
        now[late] = first[late] = middle[late[good]]
        self._guessed &= ~good
        reach = _FARTHEST * self._span * first
        self._now, self._first = np.clip(now, first - reach, first + reach), first
        self._rested += since if self._moved else 0.0
        if self._rested > _SETTLED and not self._settled:
            self._first, self._settled = self._now, True


def drift_told(names: tuple[str, ...], drift: Float) -> str | None:
    """A sentence of cords that have drifted, None where none has by 1 %."""
    far = [
        f"{name} by {100 * d:+.1f} %"
        for name, d in zip(names, drift, strict=True)
        if abs(d) >= _DRIFTED
    ]
    return f"drift of the rest reading is taken out: {', '.join(far)}" if far else None
