"""Find and correct the time shift between the signals and the markers of a recording.

At each shift, the main movements of the markers are fitted to the signals by ridge regression in
contiguous folds; each fold is predicted from the others. The best shift is the one at which the
signals explain most of the movement. Relaxation of the cords makes signals lead by 10 ms to 100 ms,
so smaller shifts are not reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...decoding.decoders import contiguous_folds
from .dataset import Dataset, Recording

#: Largest shift that is tried, in either direction.
MAX_SHIFT_S = 1.0

_SHIFT_STEP_S = 0.04  # between the shifts that are tried
_MAX_FRAMES = 3000  # frames that are compared
_MIN_FRAMES = 100
_MIN_VISIBLE_SHARE = 0.5  # of the frames, for a marker to be compared
_MOVEMENT_COUNT = 3  # main movements that are compared
_RIDGE = 1e-3  # of a signal's variance
_MIN_MOVEMENT_MM = 0.5  # standard deviation of the largest movement
# Smaller differences may be chance: the shift, the gain in explained variance, the share of folds.
_MIN_SHIFT_S, _MIN_GAIN, _MIN_FOLD_SHARE = 0.1, 0.02, 0.6
_MIN_EXPLAINED = 0.2  # of the movements' variance, at the best shift


@dataclass(frozen=True)
class TimeShift:
    """The time shift at which signals explain most of the markers' movement.

    Attributes:
        seconds: Seconds to add to the times of the samples.
        explained: Explained share of the movements' variance after the shift.
        explained_before: Explained share without a shift.
        fold_share: Share of the folds in which the shift is better.
    """

    seconds: float
    explained: float
    explained_before: float
    fold_share: float

    @property
    def is_informative(self) -> bool:
        """Whether the signals explain the movements at all."""
        return self.explained >= _MIN_EXPLAINED

    @property
    def is_significant(self) -> bool:
        """Whether the signals are certainly out of step with the markers."""
        is_better = (
            self.explained - self.explained_before > _MIN_GAIN and self.fold_share > _MIN_FOLD_SHARE
        )
        return self.is_informative and abs(self.seconds) > _MIN_SHIFT_S and is_better


def find_time_shift(
    r: Recording, max_shift: float = MAX_SHIFT_S, step: float = _SHIFT_STEP_S
) -> TimeShift | None:
    """Find the time shift between the signals and the markers of a recording.

    Args:
        r: The recording.
        max_shift: Largest shift that is tried, s.
        step: Step between the shifts, s.

    Returns:
        The best shift; None if nothing moves or too few frames are complete.
    """
    main = _main_movements(r)
    if main is None:
        return None
    time, movements = main
    count = round(max_shift / step)
    shifts = step * np.arange(-count, count + 1)
    # The same frames at all shifts: those that have signals at each.
    signals = np.stack([r.signals_at(time - shift) for shift in shifts])
    is_known = np.isfinite(signals).all(axis=(0, 2))
    if is_known.sum() < _MIN_FRAMES:
        return None
    residual = _residual_squares(signals[:, is_known], movements[is_known])  # (shifts, folds)
    total = _residual_squares(signals[:1, is_known, :0], movements[is_known]).sum()
    scores = 1 - residual.sum(axis=1) / total
    k, zero = int(scores.argmax()), len(shifts) // 2
    seconds = float(shifts[k])
    if 0 < k < len(shifts) - 1:  # the top of the parabola through three scores
        a, b, c = scores[k - 1 : k + 2]
        bend = a - 2 * b + c
        seconds += float(step * 0.5 * (a - c) / bend) if bend < 0 else 0.0
    fold_share = float((residual[k] < residual[zero]).mean())
    return TimeShift(seconds, float(scores[k]), float(scores[zero]), fold_share)


def align_samples(dataset: Dataset, shift: float | Literal["auto"]) -> tuple[Dataset, list[str]]:
    """Shift the samples so that they are in step with the markers.

    Args:
        dataset: The dataset.
        shift: Seconds to add to the times of the samples, or "auto" to find them for the
            recordings that are out of step.

    Returns:
        The dataset, whose provenance has the `shifts` that are not 0, and notes on the shifts that
        were found.

    Raises:
        TrainingError: If a recording is out of step by more than the largest shift that is tried.
    """
    if shift != "auto":
        shifts = {r.name: float(shift) for r in dataset.recordings} if shift else {}
        return _shift(dataset, shifts), []
    found = {r.name: find_time_shift(r) for r in dataset.recordings}
    shifts = {name: s.seconds for name, s in found.items() if s is not None and s.is_significant}
    too_large = [name for name, s in shifts.items() if abs(s) > 0.95 * MAX_SHIFT_S]
    if too_large:
        raise TrainingError(
            f"signals and markers are out of step by {MAX_SHIFT_S:.0f} s or more",
            code="out-of-step",
            where=too_large[0],
            action="Give the shift between the clocks as a number",
            recording=too_large[0],
        )
    notes = [f"{name}: signals were shifted by {s:+.2f} s" for name, s in shifts.items()]
    return _shift(dataset, shifts), notes


def _shift(dataset: Dataset, shifts: Mapping[str, float]) -> Dataset:
    """Add shifts in s to the times of the samples of recordings, by their names."""
    if not shifts:
        return dataset
    recordings = tuple(
        replace(r, sample_time=r.sample_time + shifts.get(r.name, 0.0)) for r in dataset.recordings
    )
    provenance = {**dataset.provenance, "shifts": dict(shifts)}
    return replace(dataset, recordings=recordings, provenance=provenance)


def _main_movements(r: Recording) -> tuple[Float, Float] | None:
    """Return frame times (t,) s and main movements (t, k) mm of the markers."""
    is_compared = r.visible.mean(axis=0) > _MIN_VISIBLE_SHARE
    if not is_compared.any():
        return None
    points = r.points[:, is_compared].reshape(len(r.time), -1)
    complete = np.flatnonzero(np.isfinite(points).all(axis=1))
    complete = complete[:: max(len(complete) // _MAX_FRAMES, 1)]
    if len(complete) < _MIN_FRAMES:
        return None
    displacements = points[complete] - points[complete].mean(axis=0)
    _, size, directions = np.linalg.svd(displacements, full_matrices=False)
    if size[0] / np.sqrt(len(complete)) < _MIN_MOVEMENT_MM:
        return None
    return r.time[complete], np.asarray(displacements @ directions[:_MOVEMENT_COUNT].T)


def _residual_squares(signals: Float, movements: Float) -> Float:
    """Return sums of squares (d, folds) of the movements that a fit does not explain.

    Movements (t, k) are fitted to signals (d, t, c) at d shifts and to their squares; each fold is
    predicted by the fit to the others.
    """
    d, t, _ = signals.shape
    s = signals - signals.mean(axis=1, keepdims=True)
    x = np.concatenate([s, s**2], axis=2)
    size = x.std(axis=1, keepdims=True)
    x = np.concatenate([np.ones((d, t, 1)), x / np.where(size > 0, size, 1.0)], axis=2)
    ends = [int(test[0]) for _, test in contiguous_folds(t)] + [t]
    folds = [slice(a, b) for a, b in pairwise(ends)]
    G = np.stack([x[:, f].swapaxes(1, 2) @ x[:, f] for f in folds], axis=1)  # (d, folds, q, q)
    B = np.stack([x[:, f].swapaxes(1, 2) @ movements[f] for f in folds], axis=1)
    squares = np.array([(movements[f] ** 2).sum() for f in folds])
    ridge = _RIDGE * t * np.diag([0.0] + [1.0] * (x.shape[2] - 1))
    fit = np.linalg.solve(
        G.sum(axis=1, keepdims=True) - G + ridge, B.sum(axis=1, keepdims=True) - B
    )
    return np.asarray(squares - 2 * (fit * B).sum(axis=(2, 3)) + (fit * (G @ fit)).sum(axis=(2, 3)))
