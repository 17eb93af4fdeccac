"""The signals at the extreme of each pose: what a re-calibration compares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..core.arrays import Float
from .dataset import Recording

_TOP = 0.9  # of a show's farthest signals, from which on it counts as the extreme
_NOT_POSES = ("rest", "free", "all")


def pose_signals(recordings: Sequence[Recording]) -> Mapping[str, Float]:
    """Of each pose that was asked for the signals (c,), the mean over its shows."""
    spread = np.nanstd(np.concatenate([r.signals for r in recordings]), axis=0)
    found: dict[str, list[Float]] = {}
    for r in recordings:
        for name, samples in shows(r):
            s = r.signals[samples]
            s = s[np.isfinite(s).all(axis=1)]
            if name in _NOT_POSES or len(s) < 3:
                continue
            far = np.linalg.norm(s / np.maximum(spread, 1e-9), axis=1)
            found.setdefault(name, []).append(np.median(s[far >= _TOP * far.max()], axis=0))
    return {name: np.mean(each, axis=0) for name, each in found.items()}


def shows(recording: Recording) -> list[tuple[str, slice]]:
    """What was asked for, and its samples."""
    ends = [*(t for t, _ in recording.poses[1:]), np.inf]
    return [
        (name, slice(*np.searchsorted(recording.sample_time, [begin, end]).tolist()))
        for (begin, name), end in zip(recording.poses, ends, strict=False)
    ]
