"""A recording is known again by what is in it, whatever file it lies in.

Formats round, count their times from elsewhere, and know other resistances at rest. What none of
that touches is how the signals go from one moment of the recording to the next.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.curves.sampling import at_times
from .dataset import Recording

_MOMENTS = 64
_GAP = 1.0  # s between samples, at most, that are still told of
_SAME = 0.998  # correlation, from which on two recordings are one


def fingerprint(r: Recording) -> tuple[float, ...]:
    """The sum of the signals at moments that are evenly spaced from the first picture to the last,
    from one to the next; zero where it is not known. Whichever order channels are in."""
    if len(r.time) < 2:
        return (0.0,) * (_MOMENTS - 1)
    moments = np.linspace(r.time[0], r.time[-1], _MOMENTS)
    total = r.signals.sum(axis=1, keepdims=True)
    steps = np.diff(at_times(moments, r.sample_time, total, _GAP)[:, 0])
    return tuple(np.round(np.nan_to_num(steps), 6).tolist())


def same_recording(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two fingerprints are of one recording."""
    a, b = np.asarray(one, float), np.asarray(other, float)
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return bool(a.shape == b.shape and size > 0 and a @ b > _SAME * size)
