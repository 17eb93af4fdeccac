"""Hum of the mains in readings: a sample rate at which it shows, and its amplitude.

Sampled at f_s, a frequency f appears at |f - k f_s| for the nearest whole k. At 50 or 60 samples
per second the hum of the mains would look constant, and at 55 both mains would look the same. So
the rate is chosen such that 50, 60, 100 and 120 Hz appear at different frequencies, away from
zero and from half of the rate. Frequencies are fitted with the board's own times of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import fdtrc

from ...core.arrays import Float
from ...sensing.voltage_divider import conversion_time

#: Frequencies of mains, Hz (IEC 60038).
MAINS_HZ = (50, 60)
#: Relative error of the frequency: the board's ceramic resonator (0.5 %) and the mains (0.1 %).
_CLOCK_RTOL = 0.006
_HARMONICS = 2  # rectifiers add twice the frequency
#: Distance between the apparent frequencies that suffices, Hz: twice what the clock's error makes
#: of 120 Hz, and ten times the resolution of a rest of 5 s.
_SUFFICIENT_DISTANCE_HZ = 2.0
#: Largest share of the time between samples, or of the serial line, that is used.
_MAX_LOAD = 0.8
_LINE_BYTES_PER_S = 11520.0  # 115200 baud, 8N1
#: Bytes of a frame besides 3 per channel (`serial_frames`): head 12, check 2, COBS 2.
_FRAME_BYTES = 16
_MAX_RATE_HZ, _MIN_RATE_HZ = 500, 20  # of the firmware; below, steps take too long
#: Rates above this are not needed: 240 Hz is twice the highest frequency of interest.
_HIGH_RATE_HZ = 250
_OUTLIER_SIGMAS = 5.0  # beyond which samples are clipped before the fit


@dataclass(frozen=True)
class Sampling:
    """Settings of a read-out board for the check.

    Attributes:
        rate: Samples per second, Hz.
        averages: Conversions per sample.
        distance: Smallest distance between the apparent frequencies of the mains, zero and half
            of the rate, Hz.
    """

    rate: int
    averages: int
    distance: float


def apparent_frequency(frequency: float, rate: float) -> float:
    """Return the frequency at which samples show a vibration, Hz.

    Args:
        frequency: Frequency of the vibration, Hz.
        rate: Samples per second, Hz.
    """
    return abs(frequency - rate * round(frequency / rate))


def hum_distance(rate: float) -> float:
    """Return the smallest distance between apparent frequencies of hum, 0 and half the rate, Hz."""
    shown = [apparent_frequency(k * f, rate) for f in MAINS_HZ for k in range(1, _HARMONICS + 1)]
    distances = [abs(a - b) for a, b in combinations([0.0, rate / 2, *shown], 2)]
    # Zero and half of the rate are far apart, and do not move.
    return min(distances)


def choose_sampling(converter: int, channels: int, averages: int) -> Sampling:
    """Choose the rate and the averages of the check, which the board can reach.

    More averages are preferred to a higher rate as long as all frequencies can be distinguished.

    Args:
        converter: Converter of the read-out board, 0 or 1.
        channels: Number of channels.
        averages: The board's own number of conversions per sample.
    """
    options = []
    while averages >= 1:
        seconds = conversion_time(converter, channels, averages)
        line = _LINE_BYTES_PER_S / (_FRAME_BYTES + 3 * channels)
        limit = int(min(_MAX_LOAD / seconds, _MAX_LOAD * line, _MAX_RATE_HZ, _HIGH_RATE_HZ))
        rates = range(min(_MIN_RATE_HZ, limit), limit + 1)
        best = max(rates, key=lambda r: (min(hum_distance(r), _SUFFICIENT_DISTANCE_HZ), r))
        options.append(Sampling(best, averages, hum_distance(best)))
        if options[-1].distance >= _SUFFICIENT_DISTANCE_HZ:
            return options[-1]
        averages //= 2
    return max(options, key=lambda o: o.distance)


@dataclass(frozen=True)
class Hum:
    """Hum of the mains in one channel.

    Attributes:
        frequency: 50 or 60 Hz.
        rms: Root mean square, in the unit of the values.
        false_alarm: Upper limit of the probability that white noise alone fits as well.
        residual: Values without hum, offset and drift (n,).
    """

    frequency: int
    rms: float
    false_alarm: float
    residual: Float


def fit_hum(time: Float, values: Float) -> Hum:
    """Fit the hum of the mains by least squares.

    The values are an offset, a drift of second degree, and vibrations at the mains' frequency and
    twice that frequency.

    Args:
        time: Times of the samples by the board's clock (n,), s.
        values: Values (n,).
    """
    duration = float(time[-1] - time[0])
    x = 2 * (time - time[0]) / duration - 1
    drift = np.stack([np.ones_like(x), x, x**2], axis=1)
    rest = values - drift @ np.linalg.lstsq(drift, values, rcond=None)[0]
    scale = 1.4826 * float(np.median(np.abs(rest - np.median(rest))))
    clipped = np.clip(rest, -_OUTLIER_SIGMAS * scale, _OUTLIER_SIGMAS * scale) if scale else rest
    before = float(clipped @ clipped)
    best: tuple[float, int, Float] = (np.inf, MAINS_HZ[0], np.zeros_like(values))
    tried = 0
    for mains in MAINS_HZ:
        step = 0.25 / duration
        count = int(np.ceil(_CLOCK_RTOL * mains / step))
        tried += 2 * count + 1
        for frequency in mains + step * np.arange(-count, count + 1):
            angles = 2 * np.pi * frequency * np.outer(time - time[0], np.arange(1, _HARMONICS + 1))
            waves = np.hstack([drift, np.cos(angles), np.sin(angles)])
            fit = np.linalg.lstsq(waves, clipped, rcond=None)[0]
            error = clipped - waves @ fit
            if error @ error < best[0]:
                best = float(error @ error), mains, waves[:, 3:] @ fit[3:]
    after, frequency, hum = best
    unknowns = 2 * _HARMONICS
    freedom = len(time) - 3 - unknowns
    ratio = ((before - after) / unknowns) / max(after / freedom, 1e-300)
    # An upper limit by Bonferroni's inequality: close frequencies are not independent.
    chance = float(fdtrc(unknowns, freedom, ratio)) * tried
    return Hum(frequency, float(hum.std()), min(chance, 1.0), rest - hum)
