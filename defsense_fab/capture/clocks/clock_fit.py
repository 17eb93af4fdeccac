"""Fit clocks to time stamps that are late at random.

Buffers and schedulers make stamps late, never early, so the line that relates two clocks runs below
all stamps, as close to them as possible. `fit_clocks` relates a device's clock to the host's.
`even_frame_times` finds the times of a free-running camera. It takes frames at even steps of its
own clock, so its frames are numbered, and the line of number and stamp is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

PERIOD_TOLERANCE = 0.06  # of the period, by which the median step may be wrong
MAX_PERIOD_FRAMES = 2000  # frames from which the period is found
FIRST_FRAMES = 64  # numbered by their period alone
#: Frames that may get the number of the next one because they were so late: this many, and a share.
MAX_SHARED_NUMBERS, MAX_SHARED_SHARE = 3, 0.02
BLOCK_FRAMES = 40  # frames of which at least one should be almost in time
# In periods of the camera:
MAX_LATENESS_OF_EARLIEST = 0.1  # of the earliest frame in each block
MAX_LATENESS_QUANTILE = 0.6  # of nine frames in ten
MAX_MEDIAN_LATENESS = 0.33  # of each block; more means that the rate is not constant
MAX_STEP_FRACTION = 0.3  # of a block's median step from whole periods
STAMP_TOLERANCE = 0.05  # by which a stamp may be before its time
MISNUMBERED_MARGIN = 0.03  # before the earliest fiftieth of the stamps
ONSET_WIDTH = 0.4  # within which most stamps are
MAX_EARLY_SHARE = 0.01  # of the frames may seem to come before their time


@dataclass(frozen=True)
class Clocks:
    """Relation of two clocks: host = offset + (1 + drift) device.

    Attributes:
        offset: Host time at device time zero, s.
        drift: Relative rate difference.
    """

    offset: float
    drift: float

    def to_host(self, device: Float) -> Float:
        """Return the host's times, s, of device times, s."""
        return np.asarray(self.offset + (1 + self.drift) * np.asarray(device))


@dataclass(frozen=True)
class ClockMatch:
    """Fitted relation: camera - middle = (1 + drift) (device - device_middle), s.

    Attributes:
        drift: Relative rate difference.
        sigma: Standard deviation of the offset at the middle, s.
        drift_sigma: Standard deviation of `drift`.
        middle: Camera time, s.
        device_middle: Device time, s.
        span: Time that was compared, s.
    """

    drift: float
    sigma: float
    drift_sigma: float
    middle: float
    device_middle: float
    span: float

    @property
    def end_sigma(self) -> float:
        """Standard deviation of the offset at the ends of the span, s."""
        return float(np.hypot(self.sigma, self.drift_sigma * self.span / 2))


def fit_clocks(device: Float, host: Float) -> Clocks:
    """Relate a device's clock to the host's.

    The line that runs closest below all arrivals is the edge of their lower convex hull at the mean
    time, which solves that linear program.

    Args:
        device: Times (t,) of the device's clock at which frames were sent, s.
        host: Times (t,) of the host's clock at which they arrived, s.

    Returns:
        The relation; without drift if there are fewer than two different device times.

    References:
        Moon, Skelly & Towsley (1999), Estimation and removal of clock skew from network delay
        measurements.
    """
    device_start, host_start = float(device[0]), float(host[0])
    # Subtracted before the fit, so that the drift keeps its digits.
    x, y = device - device_start, host - host_start - (device - device_start)
    if np.ptp(x) <= 0:
        return Clocks(float((host - device).min()), 0.0)
    hull: list[int] = []
    for i in np.lexsort((y, x)):
        while len(hull) > 1 and _turns_right(x, y, hull[-2], hull[-1], int(i)):
            hull.pop()
        if not hull or x[i] > x[hull[-1]]:
            hull.append(int(i))
    k = int(np.clip(np.searchsorted(x[hull], x.mean()), 1, len(hull) - 1))
    a, b = hull[k - 1], hull[k]
    drift = float((y[b] - y[a]) / (x[b] - x[a]))
    offset = float(y[a] - drift * x[a])
    return Clocks(host_start + offset - (1 + drift) * device_start, drift)


def _turns_right(x: Float, y: Float, a: int, b: int, c: int) -> bool:
    return bool((x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a]) <= 0)


@dataclass(frozen=True)
class FrameTimes:
    """Times of a camera's frames.

    Attributes:
        time: Times (t,), s.
        is_even: Whether the frames have one rate; if not, `time` holds the stamps.
    """

    time: Float
    is_even: bool


def even_frame_times(stamp: Float) -> FrameTimes:
    """Find the times of frames from late stamps.

    Args:
        stamp: Stamps (t,), s, that never go back; frames may be missing.

    Returns:
        Times on an even grid, or the stamps themselves if the frames do not have one rate.
    """
    unchanged = FrameTimes(stamp, False)
    step = np.diff(stamp)
    if len(stamp) < BLOCK_FRAMES or not (step > 0).any():
        return unchanged
    count, line, start = min(FIRST_FRAMES, len(stamp)), np.zeros(0), float(stamp[0])
    period, tolerance = float(np.median(step[step > 0])), PERIOD_TOLERANCE
    while True:
        period = _find_period(stamp[:count] - start, period, tolerance)
        for _ in range(3):
            number = _number_frames((stamp[:count] - start) / period)
            if count - len(np.unique(number)) > MAX_SHARED_NUMBERS + MAX_SHARED_SHARE * count:
                return unchanged
            number = _make_increasing(number)
            x = number - number[0]
            residual = stamp[:count] - np.polyval(np.polyfit(x, stamp[:count], 1), x)
            # A frame that was so late that it got the next number would bend the line.
            limit = np.quantile(residual, 0.02) - MISNUMBERED_MARGIN * period
            is_fair = residual >= limit
            clocks = fit_clocks(number[is_fair], stamp[:count][is_fair])
            start, period = clocks.offset, 1 + clocks.drift
        line = start + period * number
        if count == len(stamp):
            break
        count = min(2 * count, len(stamp))
        tolerance = 1 / count  # by which the last of them would be a frame off
    is_even = _has_one_rate(stamp, stamp - line, period)
    return FrameTimes(line, True) if is_even else unchanged


def _has_one_rate(stamp: Float, delay: Float, period: float) -> bool:
    """Return whether stamps (t,) s with these delays (t,) s are those of an even camera."""
    blocks = np.array_split(delay, max(len(delay) // BLOCK_FRAMES, 1))
    earliest = max(float(block.min()) for block in blocks)
    # A camera that changes its rate, for example by a longer exposure, is not even.
    ends = (delay[:BLOCK_FRAMES], delay[-BLOCK_FRAMES:])
    median = max(float(np.median(block)) for block in (*blocks, *ends))
    step = np.diff(stamp) / period
    step_blocks = (*np.array_split(step, len(blocks)), step[-BLOCK_FRAMES:])
    steps = [float(np.median(block)) for block in step_blocks]
    fraction = max(abs(s - round(s)) for s in steps)
    early = (delay < -MAX_LATENESS_OF_EARLIEST * period).sum() > MAX_EARLY_SHARE * len(delay)
    return not (
        earliest > MAX_LATENESS_OF_EARLIEST * period
        or median > MAX_MEDIAN_LATENESS * period
        or fraction > MAX_STEP_FRACTION
        or np.quantile(delay, 0.9) > MAX_LATENESS_QUANTILE * period
        or early
    )


def _find_period(time: Float, guess: float, tolerance: float) -> float:
    """Return the period at which the fractions of the times, in periods, agree best."""
    time = time[:: max(len(time) // MAX_PERIOD_FRAMES, 1)]
    periods = guess * np.linspace(1 - tolerance, 1 + tolerance, 241)
    agreement = [abs(np.exp(2j * np.pi * time / p).mean()) for p in periods]
    return float(periods[int(np.argmax(agreement))])


def _make_increasing(number: Float) -> Float:
    """Make frame numbers increase: a frame more than a period late got the next one's number."""
    x = np.arange(len(number))
    return np.asarray(np.minimum.accumulate((number - x)[::-1])[::-1] + x)


def _number_frames(time: Float) -> Float:
    """Number frames from their times, in periods, which are late by less than one period.

    Most frames are late by little. So the fractions of the times, on a circle, start where many
    follow and few precede.
    """
    fraction = np.sort(time % 1)
    circle = np.concatenate([fraction - 1, fraction, fraction + 1])
    here, after, before = (
        np.searchsorted(circle, fraction + d) for d in (0.0, ONSET_WIDTH, -ONSET_WIDTH / 2)
    )
    onset = fraction[int(((after - here) - 2 * (here - before)).argmax())]
    return np.asarray(np.floor(time - onset + STAMP_TOLERANCE))
