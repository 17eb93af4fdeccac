"""Which pictures a model is trained on, and which it is tested on: always runs of neighbours.

Pictures beside each other show nearly the same: a test among the training's neighbours tells how
well a decoder remembers. (Roberts et al. 2017, Cross-validation strategies for data with temporal
structure, Ecography 40.)
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Int
from ...core.errors import TrainingError
from ...decoding.folds import FOLDS
from .frames import Frames

#: Of all pictures, those at the end that a model is tested on (DefSense, CHI 2016, section 6).
TEST_SHARE = 0.3


def first_and_last(frames: Frames, share: float = TEST_SHARE) -> tuple[Frames, Frames]:
    """The first pictures, and the last `share` of them. Raises TrainingError for no share."""
    if not 0 <= share < 1:
        raise TrainingError(
            f"the share of pictures to test on must be from 0 to below 1, not {share:g}",
            code="share-out-of-range",
            share=share,
        )
    cut = len(frames) - round(share * len(frames))
    return frames.part(slice(0, cut)), frames.part(slice(cut, len(frames)))


def fold_of(count: int, folds: int = FOLDS) -> Int:
    """The fold (t,) of each of `count` pictures: contiguous, of nearly equal sizes."""
    return np.repeat(np.arange(folds), [len(p) for p in np.array_split(np.arange(count), folds)])
