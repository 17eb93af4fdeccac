"""Independent samples from errors that are correlated from frame to frame.

Neighboring frames have nearly the same error: 2,000 of them are worth perhaps 40 independent ones.
Means of blocks that are long compared with the autocorrelation time are independent.

References:
    Sokal 1997, Monte Carlo Methods in Statistical Mechanics, section 3 (batch means).
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int

# Autocorrelation times in a block: means of neighboring blocks are then correlated by 4 %.
_BLOCK_TIMES = 6.0
_WINDOW_TIMES = 5.0  # autocorrelation times over which autocorrelations are summed


def autocorrelation_time(errors: Float, run: Int) -> float:
    """Compute the integrated autocorrelation time of errors.

    It is 1 + 2 times the sum of the autocorrelations, summed over five times itself. So many frames
    are worth one independent frame.

    Args:
        errors: Errors of the frames, shape (t,).
        run: Index of each frame's run, shape (t,).

    Returns:
        The time in frames; 1 for independent frames.
    """
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
    is_complete = np.arange(longest) >= _WINDOW_TIMES * time
    return float(max(time[int(is_complete.argmax()) if is_complete.any() else -1], 1.0))


def block_length(time: float) -> int:
    """Return the length in frames of blocks for an autocorrelation time in frames."""
    return int(np.ceil(_BLOCK_TIMES * time))


def block_means(errors: Float, run: Int, length: int) -> Float:
    """Compute the means of blocks of frames.

    Args:
        errors: Errors of the frames, shape (t,).
        run: Index of each frame's run, shape (t,). No block spans two runs.
        length: Smallest length of a block, in frames. The remainder of a run is distributed over
            its blocks; a run shorter than a block has none.

    Returns:
        The means, shape (b,).
    """
    means = []
    for k in np.unique(run):
        run_errors = errors[run == k]
        blocks = len(run_errors) // length
        if blocks:
            means += [float(part.mean()) for part in np.array_split(run_errors, blocks)]
    return np.array(means)
