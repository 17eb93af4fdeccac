"""The signals at the extreme of each pose: what a re-calibration compares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.arrays import Float
from ..data.dataset import Recording

_TOP = 0.9  # of a show's farthest signals, from which on it counts as the extreme
_BEGINS = 1.0  # s, in which hands still leave what was shown before
_NOT_POSES = ("rest", "free", "all")


def pose_signals(recordings: Sequence[Recording]) -> Mapping[str, Float]:
    """Of each pose that was asked for the signals (c,): the mean over that half of its shows which
    went farthest."""
    spread = np.nanstd(np.concatenate([r.signals for r in recordings]), axis=0)
    found: dict[str, list[tuple[float, Float]]] = {}
    for r in recordings:
        for name, samples in shows(r):
            time = r.sample_time[samples]
            s = r.signals[samples][time > time[:1] + _BEGINS]
            s = s[np.isfinite(s).all(axis=1)]
            if name in _NOT_POSES or len(s) < 3:
                continue
            far = np.linalg.norm(s / np.maximum(spread, 1e-9), axis=1)
            extreme = np.median(s[far >= _TOP * far.max()], axis=0)
            found.setdefault(name, []).append((float(far.max()), extreme))
    return {name: _mean_of_farthest(each) for name, each in found.items()}


def _mean_of_farthest(extremes: list[tuple[float, Float]]) -> Float:
    order = sorted(extremes, key=lambda e: -e[0])
    half = order[: (len(order) + 1) // 2]
    return np.asarray(np.mean([signals for _, signals in half], axis=0))


def shows(recording: Recording) -> list[tuple[str, slice]]:
    """What was asked for, and its samples."""
    ends = [*(t for t, _ in recording.poses[1:]), np.inf]
    return [
        (name, slice(*np.searchsorted(recording.sample_time, [begin, end]).tolist()))
        for (begin, name), end in zip(recording.poses, ends, strict=False)
    ]
