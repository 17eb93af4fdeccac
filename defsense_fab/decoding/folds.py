"""Cross-validation in contiguous folds: neighbouring states are alike, and shuffled folds would
show a decoder nearly what it is tested on."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Int

FOLDS = 5


def contiguous(count: int, folds: int = FOLDS) -> list[tuple[Int, Int]]:
    """Pairs of training and test indices, each test a run of neighbours."""
    everything = np.arange(count)
    tests = np.array_split(everything, min(folds, count))
    return [(np.setdiff1d(everything, test), test) for test in tests]
