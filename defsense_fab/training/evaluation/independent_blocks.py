"""Samples that count as independent, of errors that go on from frame to frame.

Neighbouring frames have nearly the same error: 2,000 of them are worth perhaps 40 independent
ones. Means of blocks that are long beside the autocorrelation time are (batch means; Sokal, Monte
Carlo Methods in Statistical Mechanics, 1997, section 3).
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int

# Blocks are this many times as long as errors remember: neighbours' means are correlated by 4 %.
_LONG = 6.0
_WINDOW = 5.0  # autocorrelation times over which it is summed


def autocorrelation_time(errors: Float, run: Int) -> float:
    """Integrated, in frames: 1 + 2 sum of the autocorrelations of errors (t,) of runs (t,), summed
    over five times itself; 1 of independent frames. So many frames are worth one."""
    parts = [errors[run == k] - errors.mean() for k in np.unique(run)]
    longest = max(map(len, parts))
    size = 1 << (2 * longest - 1).bit_length()
    products, pairs = np.zeros(longest), np.zeros(longest)
    for part in parts:
        spectrum = np.abs(np.fft.rfft(part, size)) ** 2
        n = len(part)
        products[:n] += np.fft.irfft(spectrum, size)[:n]
        pairs[:n] += n - np.arange(n)
    if products[0] <= 1e-24 * max(float((errors**2).sum()), 1e-300):
        return 1.0
    rho = products / pairs
    time = 2 * np.cumsum(rho / rho[0]) - 1
    enough = np.arange(longest) >= _WINDOW * time
    return float(max(time[int(enough.argmax()) if enough.any() else -1], 1.0))


def block_length(time: float) -> int:
    """Frames of a block, of errors with an autocorrelation time in frames."""
    return int(np.ceil(_LONG * time))


def block_means(errors: Float, run: Int, length: int) -> Float:
    """Means (b,) of blocks of `length` frames of errors (t,), none of two runs; what is left over
    at the end of a run is spread over its blocks, and a run shorter than a block gives none."""
    means = []
    for k in np.unique(run):
        own = errors[run == k]
        blocks = len(own) // length
        if blocks:
            means += [float(part.mean()) for part in np.array_split(own, blocks)]
    return np.array(means)
