"""Measure the resistances at rest, R0, and follow their drift.

Rubber cords drift by per cents in hours, more than some poses change them, and they set in the
first cycles after a long rest (the Mullins effect). If the training began with a rest, the effect
of setting is known and taken into account from the start. Readings of a device that lies still
near its rest count as rest: R0 is their mean over the last half minute, so that a hand that pauses
in the middle of a pose counts no more than it lasts.

Some cords are noisy, so their readings at rest vary by more than a small share of their range. Such
changes count as rest if they look like noise: movements change the readings steadily. Channels that
hardly change in any pose are ignored.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float
from .live_frame import Note

# Spans are the ranges of channels in the training.
_WINDOW_S = 1.5  # in which a device at rest hardly changes
_MAX_STILL_CHANGE = 0.04  # of the span, between the means of the parts of the window
_WINDOW_PARTS = 5
_NOISY_WINDOW_S = 3.0  # the window if a channel is noisy
_NOISY_PARTS = 10
_MAX_NOISE_CHANGE = 0.2  # of the span, or of a large share of the largest span
_SHARE_OF_LARGEST = 0.4
_MAX_NOISE_STEPS = 4.0  # of the mean step between parts: noise has 2 to 4, movements 4.5 and more
_SILENT_SHARE = 0.05  # of the largest span: channels with a smaller one are ignored
_MAX_REST_OFFSET = 0.15  # of the span: readings farther from R0 are no rest
_MIN_MOVE = 0.4  # of the span: a device that went so far has been moved
_PRIOR_REST_S = 5.0  # weight of a rest that was known before the device was moved
_MIN_MEAN_S, _MAX_MEAN_S = 0.5, 30.0  # of rest that R0 is the mean of
_SETTLING_S = 2.0  # of rest after movement, after which R0 counts as measured again
_MAX_DRIFT = 0.3  # of the span: a larger change of R0 is a pose
_MIN_REPORTED_DRIFT = 0.01  # relative change of R0
_MIN_SAMPLES = 10
_CHECK_INTERVAL_S = 0.1


@dataclass(frozen=True)
class Rest:
    """The resistances at rest, as known at one sample.

    Attributes:
        ohms: R0 (c,), ohm; None until it was measured, NaN of channels that never could be.
        is_still: Whether the device lies still now.
        is_resting: Whether it lies still at its rest.
        has_settled: Whether it has rested after it was moved, so that its cords have set.
        drift: Relative change (c,) of R0 since then.
        is_drift_limited: Whether the drift has reached the largest value that is followed.
    """

    ohms: Float | None
    is_still: bool
    is_resting: bool
    has_settled: bool
    drift: Float
    is_drift_limited: bool


class RestTracker:
    """Track R0, sample after sample.

    Args:
        span: Range of (R - R0)/R0 of each channel in the training (c,).
        ohms: R0 (c,), ohm, if it is known. Otherwise R0 is the median of the first period in which
            nothing but noise changes the readings.
        first_rest_signals: Signals (c,) in the training's first rest, before cords had set; the
            first period is corrected by them.
        trained_ohms: R0 (c,) in the training, ohm, from which R0 of a channel is estimated while it
            cannot be measured.
        rest_signals: Returns the signals (c,) that are expected of a device at rest that has been
            moved, since its cords remember that; NaN where they are not known. Signals of no
            effect are zero if it is given True, and the present ones if False. None for zero.
    """

    def __init__(
        self,
        span: Float,
        ohms: Float | None = None,
        first_rest_signals: Float | None = None,
        trained_ohms: Float | None = None,
        rest_signals: Callable[[bool], Float] | None = None,
    ) -> None:
        c = len(span)
        self._rest_signals = rest_signals or (lambda _: np.zeros(c))
        self._span, self._trained_ohms = np.maximum(span, 1e-6), trained_ohms
        self._first = self._now = None if ohms is None else np.asarray(ohms, float)
        self._setting = (
            np.ones(c)
            if first_rest_signals is None
            else 1 / (1 + np.asarray(first_rest_signals, float))
        )
        self._estimated = np.zeros(c, bool)  # channels whose R0 was not measured yet
        self._window: deque[tuple[float, Float]] = deque()
        self._last_check, self._is_still, self._is_resting = -np.inf, False, False
        self._was_moved = self._has_settled = ohms is not None
        is_known = first_rest_signals is not None or ohms is not None
        self._prior_rest_s = _PRIOR_REST_S if is_known else 0.0
        self._mean_s = self._prior_rest_s  # of rest that R0 is the mean of
        self._rest_after_move_s = 0.0

    def __call__(self, time: float, ohms: Float, lost: frozenset[int] = frozenset()) -> Rest:
        """Return the rest after a sample.

        Args:
            time: Time of the sample, s, later than of the one before.
            ohms: Resistances (c,), ohm.
            lost: Indices of channels that have failed.
        """
        if self._window and time - self._window[-1][0] > _WINDOW_S:
            self._window.clear()
        self._window.append((time, ohms))
        while time - self._window[0][0] > _NOISY_WINDOW_S:
            self._window.popleft()
        if time - self._last_check >= _CHECK_INTERVAL_S:
            self._check(time - self._last_check, lost)
            self._last_check = time
        return self.rest

    def set_now(self, lost: frozenset[int] = frozenset()) -> bool:
        """Take the latest readings as R0; return whether any channel could be read."""
        good = self._good_channels(lost)
        R = np.array([ohms for _, ohms in self._window][-_MIN_SAMPLES:])
        R = R.reshape(-1, len(self._span))
        good &= np.isfinite(R).all(axis=0) & (R > 0).all(axis=0)
        if not len(R) or not good.any():
            return False
        median = np.median(R[:, good], axis=0)
        largest = _MAX_REST_OFFSET * self._span
        remembered = np.nan_to_num(np.clip(self._rest_signals(True), -largest, largest))
        self._start(good, median / (1 + remembered[good]))
        self._was_moved = self._has_settled = True
        self._mean_s = _PRIOR_REST_S
        return True

    def former(self) -> Callable[[], None]:
        """Return a function that restores the present R0."""
        first, now, estimated = self._first, self._now, self._estimated
        state = (self._was_moved, self._has_settled, self._mean_s)

        def restore() -> None:
            self._first, self._now, self._estimated = first, now, estimated
            self._was_moved, self._has_settled, self._mean_s = state

        return restore

    @property
    def rest(self) -> Rest:
        """The rest after the last sample."""
        if self._first is None or self._now is None:
            no_drift = np.zeros(len(self._span))
            return Rest(None, self._is_still, self._is_resting, False, no_drift, False)
        drift = np.nan_to_num(self._now / self._first - 1)
        is_limited = bool((np.abs(drift) >= 0.999 * _MAX_DRIFT * self._span).any())
        return Rest(
            self._now, self._is_still, self._is_resting, self._has_settled, drift, is_limited
        )

    def _good_channels(self, lost: frozenset[int]) -> Bool:
        return np.array([c not in lost for c in range(len(self._span))])

    def _check(self, since: float, lost: frozenset[int]) -> None:
        good = self._good_channels(lost)
        self._is_still = self._is_resting = False
        R = self._readings(_WINDOW_S, good)
        if R is None:
            return
        median = np.median(R, axis=0)
        if self._now is not None and not self._was_moved and self._offset(good, median) > _MIN_MOVE:
            self._was_moved, self._mean_s = True, self._prior_rest_s
        R = self._still_readings(good, R)
        if R is None:
            return
        self._is_still, median = True, np.median(R, axis=0)
        setting = 1 / (1 + self._rest_signals(False)) if self._was_moved else self._setting
        median = median * setting[good]
        if self._now is None:
            self._start(good, median)
            self._is_resting = True
        elif self._offset(good, median) <= _MAX_REST_OFFSET:
            self._is_resting = True
            self._follow(good, median, min(since, 0.2))

    def _readings(self, seconds: float, good: Bool) -> Float | None:
        """Return the latest readings (n, g) of `good` channels, or None if there are too few."""
        end = self._window[-1][0]
        recent = [(time, ohms) for time, ohms in self._window if end - time <= seconds]
        if end - recent[0][0] < 0.8 * seconds or len(recent) < _MIN_SAMPLES or not good.any():
            return None
        R = np.array([ohms for _, ohms in recent])[:, good]
        return R if np.isfinite(R).all() and (R > 0).all() else None

    def _still_readings(self, good: Bool, R: Float) -> Float | None:
        """Return readings (n, g) of `good` channels at rest; None if the device moves.

        They are those of the short window, R (m, g), or of the long one if a channel is noisy.
        """
        span, is_sensitive = self._span[good], self._is_sensitive(good)
        change, _ = _changes(R, _WINDOW_PARTS)
        if (change <= _MAX_STILL_CHANGE * span)[is_sensitive].all():
            return R
        longer = self._readings(_NOISY_WINDOW_S, good)
        if longer is None:
            return None
        change, step = _changes(longer, _NOISY_PARTS)
        reach = np.maximum(span, _SHARE_OF_LARGEST * span.max())
        is_noise = (change <= _MAX_NOISE_CHANGE * reach) & (change <= _MAX_NOISE_STEPS * step)
        is_still = is_noise | (change <= _MAX_STILL_CHANGE * span)
        return longer if is_still[is_sensitive].all() else None

    def _is_sensitive(self, good: Bool) -> Bool:
        """Return which of the `good` channels (g,) change enough in the poses to show a rest."""
        span = self._span[good]
        return np.asarray(span >= _SILENT_SHARE * span.max())

    def _offset(self, good: Bool, median: Float) -> float:
        """Return the largest distance from R0 in spans; infinite if no R0 was measured."""
        assert self._now is not None
        measured = ~self._estimated[good] & self._is_sensitive(good)
        if not measured.any():
            return float("inf")
        offset = np.abs(median / self._now[good] - 1) / self._span[good]
        return float(offset[measured].max())

    def _start(self, good: Bool, median: Float) -> None:
        """Take the readings of `good` channels as R0; keep or estimate that of the others."""
        now = self._estimate(good, median) if self._now is None else self._now.copy()
        self._estimated = (self._estimated | (self._now is None)) & ~good
        now[good] = median
        self._first = self._now = now

    def _estimate(self, good: Bool, median: Float) -> Float:
        if self._trained_ohms is None:
            return np.full(len(self._span), np.nan)
        return np.asarray(self._trained_ohms * np.median(median / self._trained_ohms[good]))

    def _follow(self, good: Bool, median: Float, since: float) -> None:
        """Update the mean of rests by the readings of `good` channels."""
        assert self._now is not None
        assert self._first is not None
        self._mean_s = min(self._mean_s + since, _MAX_MEAN_S)
        now, first = self._now.copy(), self._first.copy()
        now[good] += since / max(self._mean_s, _MIN_MEAN_S) * (median - now[good])
        first_measured = self._estimated & good
        now[first_measured] = first[first_measured] = median[first_measured[good]]
        self._estimated &= ~good
        reach = _MAX_DRIFT * self._span * first
        self._now, self._first = np.clip(now, first - reach, first + reach), first
        self._rest_after_move_s += since if self._was_moved else 0.0
        if self._rest_after_move_s > _SETTLING_S and not self._has_settled:
            self._first, self._has_settled = self._now, True


def _changes(R: Float, parts: int) -> tuple[Float, Float]:
    """Return how far the means of parts of readings (n, c) are apart, relative to the readings.

    Returns:
        The largest distance (c,), and the mean one between successive parts (c,).
    """
    means = np.array([part.mean(axis=0) for part in np.array_split(R, parts)])
    means /= np.median(R, axis=0)
    return np.ptp(means, axis=0), np.abs(np.diff(means, axis=0)).mean(axis=0)


def drift_note(channels: tuple[str, ...], drift: Float) -> Note | None:
    """Return a note on the channels (c,) with a relative `drift` (c,) of 1 % or more, if any."""
    drifted = {
        name: float(d)
        for name, d in zip(channels, drift, strict=True)
        if abs(d) >= _MIN_REPORTED_DRIFT
    }
    if not drifted:
        return None
    parts = ", ".join(f"{name} by {100 * d:+.1f} %" for name, d in drifted.items())
    return Note("rest-drifted", f"the drift of the readings at rest is removed: {parts}", drifted)
