"""The signals at the extreme of each pose: what a re-calibration compares.

A hand that is asked for a pose often still leaves the one before, and does not always go all the
way. So the extreme is sought along the direction in which the pose's shows agree, or along that of
the training, and shows that go less than half as far as the others do not count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ..data.dataset import Dataset, Recording

# What signals are in the first rest of a session, before cords have set.

_BEGINS_FIRST_REST = 0.5  # s of it in which hands still leave the device


def first_rest(dataset: Dataset) -> Mapping[str, float] | None:
    """By channel: the median over sessions that begin with a rest; None where none does."""
    first: dict[str, Recording] = {}
    for r in dataset.recordings:
        first.setdefault(r.session, r)
    rows = []
    for r in first.values():
        if len(r.poses) < 2 or r.poses[0][1] != "rest":
            continue
        begin = max(r.poses[0][0], r.sample_time[0]) + _BEGINS_FIRST_REST
        s = r.signals[(r.sample_time >= begin) & (r.sample_time < r.poses[1][0])]
        s = s[np.isfinite(s).all(axis=1)]
        if len(s):
            rows.append(np.median(s, axis=0))
    if not rows:
        return None
    return dict(zip(dataset.channels, np.median(rows, axis=0).tolist(), strict=True))


_TOP = 0.9  # of a show's farthest signals, from which on it counts as the extreme
_BEGINS = 1.0  # s, in which hands still leave what was shown before
_SAMPLES = 3  # of a show, at least
_FAR = 0.5  # of how far the farthest show went, at least
_SPREAD = (
    0.06  # of a pose's signals, from one show to another of cords that remember: what is usual
)
_USUAL = 2.0  # shows that this counts for
_NOT_POSES = ("rest", "free", "all")


@dataclass(frozen=True)
class PoseSignals:
    """At the extreme of one pose: signals (c,), the standard deviation from one show to another
    (the root mean square over channels, drawn to what is usual where shows are few), how many
    `shows` that is of, and how far the farthest went, in terms of what was expected (one where
    nothing was)."""

    signals: Float
    spread: float
    shows: int
    reach: float


def pose_signals(
    recordings: Sequence[Recording], expected: Mapping[str, Float] | None = None
) -> Mapping[str, PoseSignals]:
    """Of each pose that was asked for; of those only that are `expected` to have signals (c,), if
    any are."""
    found: dict[str, list[Float]] = {}
    for r in recordings:
        for name, samples in shows(r):
            time = r.sample_time[samples]
            s = r.signals[samples][time > time[:1] + _BEGINS]
            s = s[np.isfinite(s).all(axis=1)]
            known = expected is None or name in expected
            if name not in _NOT_POSES and known and len(s) >= _SAMPLES and s.any():
                found.setdefault(name, []).append(s)
    return {name: _extreme(each, (expected or {}).get(name)) for name, each in found.items()}


def _extreme(each: Sequence[Float], expected: Float | None) -> PoseSignals:
    """Of signals (n, c) in each show of a pose."""
    along = _agreed(each) if expected is None else expected / np.linalg.norm(expected)
    reach = np.array([(s @ along).max() for s in each])
    farthest = float(reach.max())
    whole = 1.0 if expected is None else farthest / float(np.linalg.norm(expected))
    if farthest <= 0:  # the pose was not shown at all
        return PoseSignals(np.zeros(len(along)), 0.0, 0, whole)
    far = [_top(s, s @ along) for s, r in zip(each, reach, strict=True) if r >= _FAR * farthest]
    each_way = np.array([s / (s @ along) for s in far])
    half = np.sort(reach)[::-1][: (len(far) + 1) // 2].mean()
    off = ((each_way - each_way.mean(axis=0)) ** 2).sum() / len(along)
    square = (off + _USUAL * _SPREAD**2) / (len(far) - 1 + _USUAL)
    spread = half * float(np.sqrt(square))
    return PoseSignals(half * np.median(each_way, axis=0), spread, len(far), whole)


def _agreed(each: Sequence[Float]) -> Float:
    """The direction (c,) of that show which is most like all others."""
    far = np.array([_top(s, np.linalg.norm(s, axis=1)) for s in each])
    ways = far / np.maximum(np.linalg.norm(far, axis=1, keepdims=True), 1e-12)
    return np.asarray(ways[np.argmax((ways @ ways.T).sum(axis=1))])


def _top(signals: Float, height: Float) -> Float:
    return np.asarray(np.median(signals[height >= _TOP * height.max()], axis=0))


def shows(recording: Recording) -> list[tuple[str, slice]]:
    """What was asked for, and its samples."""
    ends = [*(t for t, _ in recording.poses[1:]), np.inf]
    return [
        (name, slice(*np.searchsorted(recording.sample_time, [begin, end]).tolist()))
        for (begin, name), end in zip(recording.poses, ends, strict=False)
    ]
