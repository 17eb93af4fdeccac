"""Test whether one model's errors are smaller than another's, or only by chance.

Models are compared by the differences of their errors on the same frames, so that errors that they
share cancel. Frames are not independent samples: neighboring ones have nearly the same error. So
the samples are means of blocks that are long compared with the differences' autocorrelation time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ...core.arrays import Float, Int
from .decoded_frames import DecodedFrames, select_common
from .independent_blocks import autocorrelation_time, block_length, block_means

#: Probability of chance below which a difference is significant.
SIGNIFICANCE_LEVEL = 0.05

_MIN_BLOCKS = 4


@dataclass(frozen=True)
class PairedTest:
    """Paired t test of two models, from block means of the differences of their errors.

    Attributes:
        first: Name of the first model.
        second: Name of the second model.
        difference: Mean error of the first minus that of the second, mm.
        low: Lower end of its 95 % interval, mm.
        high: Upper end of its interval, mm.
        p: Probability of such a difference by chance, corrected for the number of tests (Holm).
        blocks: Number of blocks.
        block_frames: Length of the blocks, frames.
    """

    first: str
    second: str
    difference: float
    low: float
    high: float
    p: float
    blocks: int
    block_frames: int


@dataclass(frozen=True)
class Comparison:
    """Comparison of k models on the frames that all of them decode.

    Attributes:
        names: Names of the models.
        means: Mean errors, shape (k,), mm; NaN without common frames.
        tests: Tests of all pairs of models; a pair is missing if its errors are correlated for so
            long that there are too few blocks.
    """

    names: tuple[str, ...]
    means: Float
    tests: tuple[PairedTest, ...]


def compare(models: Sequence[tuple[str, DecodedFrames]]) -> Comparison:
    """Compare the errors of models.

    Args:
        models: Decoded frames of the same dataset by two models or more, with their names.

    Returns:
        The tests.
    """
    names = tuple(name for name, _ in models)
    frames = select_common([frames for _, frames in models])
    errors = [f.frame_error for f in frames]
    tests = [
        test
        for i, j in combinations(range(len(models)), 2)
        if (test := _compare_pair(names[i], names[j], errors[i] - errors[j], frames[i].run))
    ]
    means = np.array([e.mean() if len(e) else np.nan for e in errors])
    return Comparison(names, means, _correct_holm(tests))


def _compare_pair(first: str, second: str, difference: Float, run: Int) -> PairedTest | None:
    """Test the differences (t,) of two models' errors; None if there are too few blocks."""
    from scipy import stats

    if not len(difference):
        return None
    length = block_length(autocorrelation_time(difference, run))
    blocks = block_means(difference, run, length)
    n = len(blocks)
    if n < _MIN_BLOCKS:
        return None
    mean = float(blocks.mean())
    error = float(blocks.std(ddof=1) / np.sqrt(n))
    half_width = float(stats.t.ppf(1 - SIGNIFICANCE_LEVEL / 2, n - 1)) * error
    p = float(2 * stats.t.sf(abs(mean) / error, n - 1)) if error > 0 else float(mean == 0)
    return PairedTest(
        first, second, mean, mean - half_width, mean + half_width, p, blocks=n, block_frames=length
    )


def _correct_holm(tests: Sequence[PairedTest]) -> tuple[PairedTest, ...]:
    """Correct p for the number of tests (Holm 1979, A simple sequentially rejective procedure)."""
    corrected, largest = list(tests), 0.0
    for rank, index in enumerate(np.argsort([test.p for test in tests])):
        largest = max(largest, min((len(tests) - rank) * tests[index].p, 1.0))
        corrected[index] = replace(tests[index], p=largest)
    return tuple(corrected)
