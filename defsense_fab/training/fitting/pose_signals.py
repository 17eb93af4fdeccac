"""Signals at the extreme of each pose, and at rest, from the poses requested in recordings.

A user who is prompted for a pose is often still leaving the previous one, and does not always
go all the way. So the extreme is searched along the direction in which the pose's repetitions
agree, or along that of the training. Repetitions that go less than half as far as the farthest one
do not count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ..data.dataset import Dataset, Recording

_REST_TRANSITION_S = 0.5  # at the start of a rest, in which hands still leave the device
_POSE_TRANSITION_S = 1.0  # at the start of a pose, in which hands still leave the previous one
_EXTREME_SHARE = 0.9  # of a repetition's largest signal, from which samples count as the extreme
_MIN_SAMPLES = 3  # of a repetition
_MIN_REACH_RATIO = 0.5  # of the reach of the farthest repetition
_USUAL_SPREAD = 0.06  # of a pose's signals, between repetitions of cords with memory
_USUAL_WEIGHT = 2.0  # repetitions that the usual spread counts for
_NOT_POSES = ("rest", "free", "all")


@dataclass(frozen=True)
class PoseSignals:
    """Signals at the extreme of one pose.

    Attributes:
        signals: Signals (R - R0)/R0, shape (c,).
        spread: Standard deviation between repetitions: root mean square over the channels, drawn
            toward the usual value if there are few repetitions.
        repetitions: Number of repetitions used.
        reach: How far the farthest repetition went, relative to the expected signals; 1 if none
            were expected.
    """

    signals: Float
    spread: float
    repetitions: int
    reach: float


def extract_pose_signals(
    recordings: Sequence[Recording], expected: Mapping[str, Float] | None = None
) -> Mapping[str, PoseSignals]:
    """Extract the signals at the extreme of each requested pose.

    Args:
        recordings: The recordings.
        expected: Expected signals (c,) of the poses to extract, by name; None for all poses.

    Returns:
        The signals of each pose that was shown, by name.
    """
    signals: dict[str, list[Float]] = {}
    for r in recordings:
        for name, samples in list_pose_samples(r):
            time = r.sample_time[samples]
            s = r.signals[samples][time > time[:1] + _POSE_TRANSITION_S]
            s = s[np.isfinite(s).all(axis=1)]
            is_wanted = expected is None or name in expected
            if name not in _NOT_POSES and is_wanted and len(s) >= _MIN_SAMPLES and s.any():
                signals.setdefault(name, []).append(s)
    return {
        name: _find_extreme(repetitions, (expected or {}).get(name))
        for name, repetitions in signals.items()
    }


def list_pose_samples(recording: Recording) -> list[tuple[str, slice]]:
    """Return the name of each requested pose, in order, with its samples."""
    ends = [*(t for t, _ in recording.poses[1:]), np.inf]
    return [
        (name, slice(*np.searchsorted(recording.sample_time, [start, end]).tolist()))
        for (start, name), end in zip(recording.poses, ends, strict=False)
    ]


def first_rest_signals(dataset: Dataset) -> Mapping[str, float] | None:
    """Return the signals in the first rest of the sessions, before the cords have set.

    Args:
        dataset: The dataset.

    Returns:
        By channel, the median over the sessions that start with a rest; None if there are none.
    """
    first: dict[str, Recording] = {}
    for r in dataset.recordings:
        first.setdefault(r.session, r)
    rows = []
    for r in first.values():
        if len(r.poses) < 2 or r.poses[0][1] != "rest":
            continue
        start = max(r.poses[0][0], r.sample_time[0]) + _REST_TRANSITION_S
        s = r.signals[(r.sample_time >= start) & (r.sample_time < r.poses[1][0])]
        s = s[np.isfinite(s).all(axis=1)]
        if len(s):
            rows.append(np.median(s, axis=0))
    if not rows:
        return None
    return dict(zip(dataset.channels, np.median(rows, axis=0).tolist(), strict=True))


def last_rest_signals(recordings: Sequence[Recording]) -> Float:
    """Return the median signals (c,) in the last requested rest; zero if there was none."""
    rests = [
        r.signals[samples]
        for r in recordings
        for name, samples in list_pose_samples(r)
        if name == "rest"
    ]
    rests = [s for s in rests if np.isfinite(s).any(axis=0).all()]
    if not rests:
        return np.zeros(recordings[0].ohm.shape[1])
    return np.asarray(np.nanmedian(rests[-1], axis=0))


def _find_extreme(repetitions: Sequence[Float], expected: Float | None) -> PoseSignals:
    """Find the extreme in signals (n, c) of each repetition of a pose."""
    if expected is None:
        direction = _common_direction(repetitions)
    else:
        direction = expected / np.linalg.norm(expected)
    reach = np.array([(s @ direction).max() for s in repetitions])
    farthest = float(reach.max())
    relative = 1.0 if expected is None else farthest / float(np.linalg.norm(expected))
    if farthest <= 0:  # the pose was not shown at all
        return PoseSignals(np.zeros(len(direction)), 0.0, 0, relative)
    extremes = [
        _median_extreme(s, s @ direction)
        for s, r in zip(repetitions, reach, strict=True)
        if r >= _MIN_REACH_RATIO * farthest
    ]
    scaled = np.array([s / (s @ direction) for s in extremes])
    size = np.sort(reach)[::-1][: (len(extremes) + 1) // 2].mean()
    square = ((scaled - scaled.mean(axis=0)) ** 2).sum() / len(direction)
    variance = (square + _USUAL_WEIGHT * _USUAL_SPREAD**2) / (len(extremes) - 1 + _USUAL_WEIGHT)
    spread = size * float(np.sqrt(variance))
    return PoseSignals(size * np.median(scaled, axis=0), spread, len(extremes), relative)


def _common_direction(repetitions: Sequence[Float]) -> Float:
    """Return the direction (c,) of the repetition that is most similar to all others."""
    extremes = np.array([_median_extreme(s, np.linalg.norm(s, axis=1)) for s in repetitions])
    directions = extremes / np.maximum(np.linalg.norm(extremes, axis=1, keepdims=True), 1e-12)
    return np.asarray(directions[np.argmax((directions @ directions.T).sum(axis=1))])


def _median_extreme(signals: Float, height: Float) -> Float:
    return np.asarray(np.median(signals[height >= _EXTREME_SHARE * height.max()], axis=0))
