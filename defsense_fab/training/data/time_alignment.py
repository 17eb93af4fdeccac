"""Whether signals and markers are in step: at which shift signals tell most of where markers are.

At each shift, the markers' main movements are fitted to the signals by ridge regression, in
contiguous folds of which each is told by the others. What relaxes in a cord makes its signal lead
by some 10 ms to 100 ms: less than that is not told.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from ...core.arrays import Float
from ...core.errors import TrainingError
from ...decoding.decoders import contiguous
from .dataset import Dataset, Recording

WITHIN = 1.0  # s, either way
_STEP = 0.04  # s, between the shifts that are tried
_MOST = 3000  # frames that are compared
_FEWEST = 100
_OFTEN = 0.5  # of the frames, in which a marker must be seen to be compared
_MOVEMENTS = 3  # main ones, that are compared
_RIDGE = 1e-3  # of a signal's variance
_MOVES = 0.5  # mm, standard deviation of what moves at all
_LATE, _BETTER, _SURE = 0.1, 0.02, 0.6  # s, of the variance, of the folds: less may be chance
_TOLD = 0.2  # of the movements' variance, that signals must tell at their best shift


@dataclass(frozen=True)
class Shift:
    """`seconds` to add to the times of the samples; which part of the movements' variance signals
    tell then, `best`, and as they are, `now`; in which part of the folds that is better, `sure`."""

    seconds: float
    best: float
    now: float
    sure: float

    @property
    def tells(self) -> bool:
        """Whether signals tell anything of the movements at all."""
        return self.best >= _TOLD

    @property
    def stands_out(self) -> bool:
        """Whether signals are out of step, by all that can be told."""
        better = self.best - self.now > _BETTER and self.sure > _SURE
        return self.tells and abs(self.seconds) > _LATE and better


def find_shift(r: Recording, within: float = WITHIN) -> Shift | None:
    """None where nothing moves, or too little is known."""
    movements = _movements(r)
    if movements is None:
        return None
    time, moved = movements
    tried = _STEP * np.arange(-round(within / _STEP), round(within / _STEP) + 1)
    # The same frames at all shifts: those that have signals at each.
    signals = np.stack([r.signals_at(time - d) for d in tried])
    known = np.isfinite(signals).all(axis=(0, 2))
    if known.sum() < _FEWEST:
        return None
    left = _left(signals[:, known], moved[known])  # (shifts, folds)
    scores = 1 - left.sum(axis=1) / _left(signals[:1, known, :0], moved[known]).sum()
    k, zero = int(scores.argmax()), len(tried) // 2
    seconds = float(tried[k])
    if 0 < k < len(tried) - 1:  # the top of the parabola through three
        a, b, c = scores[k - 1 : k + 2]
        seconds += float(_STEP * 0.5 * (a - c) / (a - 2 * b + c)) if a - 2 * b + c < 0 else 0.0
    sure = float((left[k] < left[zero]).mean())
    return Shift(seconds, float(scores[k]), float(scores[zero]), sure)


def shifted(dataset: Dataset, seconds: float | Mapping[str, float] | Literal["auto"]) -> Dataset:
    """With so many s added to the times of the samples: of all recordings, of those named, or of
    those that are found to be out of step. Raises TrainingError for what is no number."""
    if seconds == "auto":
        found = {r.name: find_shift(r) for r in dataset.recordings}
        each = {name: s.seconds for name, s in found.items() if s is not None and s.stands_out}
    elif isinstance(seconds, int | float):
        each = {r.name: float(seconds) for r in dataset.recordings}
    else:
        assert isinstance(seconds, Mapping)
        each = dict(seconds)
    if not all(np.isfinite(s) for s in each.values()):
        raise TrainingError(
            f"a shift of {seconds} s cannot be; give a number, or auto", code="not-a-number"
        )
    recordings = tuple(
        replace(r, sample_time=r.sample_time + each.get(r.name, 0.0)) for r in dataset.recordings
    )
    told = dict(dataset.provenance) | {"shifts": {k: v for k, v in each.items() if v}}
    return replace(dataset, recordings=recordings, provenance=told)


def put_in_step(dataset: Dataset, shift: float | Literal["auto"]) -> tuple[Dataset, list[str]]:
    """The dataset with `shift` s added to the times of its samples, or what is found ("auto"), and
    notes on what was found. Raises TrainingError where they are out of step by more than that."""
    if shift != "auto":
        return (shifted(dataset, shift) if shift else dataset), []
    dataset = shifted(dataset, "auto")
    by = dataset.provenance["shifts"]
    far = [name for name, s in by.items() if abs(s) > 0.95 * WITHIN]
    if far:
        raise TrainingError(
            f"{far[0]}: signals and markers are out of step by {WITHIN:.0f} s or more; give"
            " --offset, or --shift with a number",
            code="out-of-step",
            recording=far[0],
        )
    return dataset, [f"{name}: signals are shifted by {s:+.2f} s" for name, s in by.items()]


def _movements(r: Recording) -> tuple[Float, Float] | None:
    """Main movements (t, k) mm of the markers at times (t,) s."""
    often = r.seen.mean(axis=0) > _OFTEN
    if not often.any():
        return None
    points = r.points[:, often].reshape(len(r.time), -1)
    whole = np.flatnonzero(np.isfinite(points).all(axis=1))
    whole = whole[:: max(len(whole) // _MOST, 1)]
    if len(whole) < _FEWEST:
        return None
    moved = points[whole] - points[whole].mean(axis=0)
    _, size, across = np.linalg.svd(moved, full_matrices=False)
    if size[0] / np.sqrt(len(whole)) < _MOVES:
        return None
    return r.time[whole], np.asarray(moved @ across[:_MOVEMENTS].T)


def _left(signals: Float, moved: Float) -> Float:
    """The sums of squares (d, folds) that are left of movements (t, k) after the fit of the other
    folds to signals (d, t, c) at d shifts, their lines and squares."""
    d, t, _ = signals.shape
    s = signals - signals.mean(axis=1, keepdims=True)
    x = np.concatenate([s, s**2], axis=2)
    size = x.std(axis=1, keepdims=True)
    x = np.concatenate([np.ones((d, t, 1)), x / np.where(size > 0, size, 1.0)], axis=2)
    ends = [int(test[0]) for _, test in contiguous(t)] + [t]
    folds = [slice(a, b) for a, b in pairwise(ends)]
    G = np.stack([x[:, f].swapaxes(1, 2) @ x[:, f] for f in folds], axis=1)  # (d, folds, q, q)
    B = np.stack([x[:, f].swapaxes(1, 2) @ moved[f] for f in folds], axis=1)
    squares = np.array([(moved[f] ** 2).sum() for f in folds])
    ridge = _RIDGE * t * np.diag([0.0] + [1.0] * (x.shape[2] - 1))
    fit = np.linalg.solve(
        G.sum(axis=1, keepdims=True) - G + ridge, B.sum(axis=1, keepdims=True) - B
    )
    return np.asarray(squares - 2 * (fit * B).sum(axis=(2, 3)) + (fit * (G @ fit)).sum(axis=(2, 3)))
