"""What signals are in the first rest of a session, before cords have set."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .dataset import Dataset, Recording

_BEGINS = 0.5  # s of it in which hands still leave the device


def first_rest(dataset: Dataset) -> Mapping[str, float] | None:
    """By channel: the median over sessions that begin with a rest; None where none does."""
    first: dict[str, Recording] = {}
    for r in dataset.recordings:
        first.setdefault(r.session, r)
    rows = []
    for r in first.values():
        if len(r.poses) < 2 or r.poses[0][1] != "rest":
            continue
        begin = max(r.poses[0][0], r.sample_time[0]) + _BEGINS
        s = r.signals[(r.sample_time >= begin) & (r.sample_time < r.poses[1][0])]
        s = s[np.isfinite(s).all(axis=1)]
        if len(s):
            rows.append(np.median(s, axis=0))
    if not rows:
        return None
    return dict(zip(dataset.channels, np.median(rows, axis=0).tolist(), strict=True))
