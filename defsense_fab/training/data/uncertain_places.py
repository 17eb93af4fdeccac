"""Places of markers that cameras hardly know: seen at a slant, or by one of them alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.arrays import Bool
from .dataset import Dataset

_USUAL, _LEAST = 5.0, 1.0  # of the median; mm


def without_uncertain(dataset: Dataset) -> tuple[Dataset, float]:
    """Without places whose stated standard deviation (of the distance) is over 1 mm and over five
    times the median, and which share of the places those were. By what the tracks say of
    themselves alone: an error is never the reason. As motion-capture systems leave them out."""
    stated = [np.sqrt((r.sigma**2).sum(axis=2)) for r in dataset.recordings]
    every = np.concatenate([s[np.isfinite(s)] for s in stated])
    if not len(every):
        return dataset, 0.0
    limit = max(_USUAL * float(np.median(every)), _LEAST)
    recordings = []
    for r, s in zip(dataset.recordings, stated, strict=True):
        gone: Bool = s > limit
        points = np.where(gone[..., None], np.nan, r.points)
        recordings.append(
            replace(r, points=points, sigma=np.where(gone[..., None], np.nan, r.sigma))
        )
    seen = sum(int(r.seen.sum()) for r in dataset.recordings)
    share = float((every > limit).sum()) / max(seen, 1)
    return replace(dataset, recordings=tuple(recordings)), share
