"""How well one series predicts another at each time shift between them, block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.special import stdtrit

from ...core.arrays import Bool, Float, Int
from ...decoding.signal_history import Past, interpolate_at

# Times at which the series are compared: at most the first number, fewer for many shifts.
_MAX_POINTS, _MAX_POINTS_OF_ALL, _MIN_MAX_POINTS = 2500, 200_000, 1000
_SHIFTS_AT_ONCE = 20  # for which values are looked up, to limit memory
_MIN_POINTS = 100
_MAX_GAP_S = 0.35  # between values that are interpolated
_RIDGE = 3e-3  # of an input's variance
_FOLDS = 5
_MAX_BLOCKS, _MIN_BLOCK_S = 30, 2.0
_CONFIDENCE = 0.995  # one-sided, of the interval's ends
_MEMORIES_S, _TRAVEL_S = (1.0, 3.0, 10.0, 30.0), (1.0, 10.0)  # time constants
_MIN_MEMORY_RATIO = 10.0  # of a recording's duration and the longest time constant


@dataclass(frozen=True)
class Pair:
    """Two series of one recording: causes that predict effects.

    Attributes:
        cause_time: Times of the causes (n,), s, increasing.
        cause: Causes (n, p), finite.
        effect_time: Times of the effects (k,), s, increasing.
        effect: Effects (k, o), finite.
    """

    cause_time: Float
    cause: Float
    effect_time: Float
    effect: Float

    def reversed(self) -> Pair:
        """Return the pair with causes and effects exchanged."""
        return Pair(self.effect_time, self.effect, self.cause_time, self.cause)

    def with_memories(self, duration: float) -> Pair:
        """Add memories, unsigned travel and products to the causes.

        Args:
            duration: Duration of the recordings, s: short ones do not show long memories.
        """
        moved = tuple(T for T in _MEMORIES_S if duration >= _MIN_MEMORY_RATIO * T)
        worked = tuple(T for T in _TRAVEL_S if duration >= _MIN_MEMORY_RATIO * T)
        y = self.cause
        i, j = np.triu_indices(y.shape[1])
        inputs = [Past(moved, worked)(self.cause_time, y), y[:, i] * y[:, j], y**3]
        inputs.append(Past(worked)(self.cause_time, y**2)[:, y.shape[1] :])
        return replace(self, cause=np.concatenate(inputs, axis=1))

    def with_squares(self) -> Pair:
        """Add squares to the causes."""
        return replace(self, cause=np.concatenate([self.cause, self.cause**2], axis=1))


@dataclass(frozen=True)
class ShiftCurve:
    """What is not predicted of the effects at each shift.

    Attributes:
        shifts: Seconds (d,) by which the effects are later than in the data.
        residual: Sums of squares (d, blocks) that are not predicted.
        total: Sums of squares of the effects in all blocks.
        is_joint: Whether blocks are of several recordings. A model that extrapolates from some to
            others misses single blocks by far, so that only relative differences count.
    """

    shifts: Float
    residual: Float
    total: float
    is_joint: bool = False

    @property
    def explained(self) -> Float:
        """Predicted share (d,) of the effects' variance, in folds that are left out."""
        return np.asarray(1 - self.residual.sum(axis=1) / self.total)

    def interval(self) -> tuple[float, float, float]:
        """Return the best shift, and the smallest and largest that are not significantly worse.

        Shifts are compared block by block with the best one; few blocks make the interval wide.
        """
        sums, step = self.residual.sum(axis=1), float(self.shifts[1] - self.shifts[0])
        k, blocks = int(sums.argmin()), self.residual.shape[1]
        best = float(self.shifts[k])
        if 0 < k < len(sums) - 1:  # the bottom of the parabola through three sums
            a, b, c = sums[k - 1 : k + 2]
            bend = a - 2 * b + c
            best += float(step * 0.5 * (a - c) / bend) if bend > 0 else 0.0
        if blocks < 3:  # no standard error
            return best, float(self.shifts[0]), float(self.shifts[-1])
        worse = self.residual - self.residual[k]
        relative = worse / np.maximum(self.residual + self.residual[k], 1e-300)  # -1 to 1
        is_inside = _is_insignificant(relative)
        if not self.is_joint:
            is_inside |= _is_insignificant(worse)
        inside = self.shifts[is_inside]
        return best, float(inside[0]) - step / 2, float(inside[-1]) + step / 2


def _is_insignificant(worse: Float) -> Bool:
    """Return which rows (d,) of differences (d, blocks) have a mean that may be 0 or less."""
    blocks = worse.shape[1]
    error = worse.std(axis=1, ddof=1) / np.sqrt(blocks)
    return np.asarray(worse.mean(axis=1) <= stdtrit(blocks - 1, _CONFIDENCE) * error)


def compare_shifts(
    pairs: Sequence[Pair], shifts: Float, change_s: float = 0.0
) -> ShiftCurve | None:
    """Predict effects from causes at each of many shifts, with one model for all pairs.

    The same effects are predicted from the same number of inputs at every shift. Contiguous folds
    are predicted by the model of the others.

    Args:
        pairs: Causes and effects of each recording, with the same columns.
        shifts: Seconds (d,) to add to the times of the effects, evenly spaced.
        change_s: Predict changes within this time, s; 0 for the values themselves.

    Returns:
        The curve; None if too few effects have causes at every shift.
    """
    points = [_common_points(pair, shifts, change_s) for pair in pairs]
    limit = min(_MAX_POINTS, max(_MAX_POINTS_OF_ALL // len(shifts), _MIN_MAX_POINTS))
    stride = max(sum(map(len, points)) // limit, 1)
    points = [p[::stride] for p in points]
    count = sum(map(len, points))
    if count < _MIN_POINTS:
        return None
    effect = _center(
        [
            _values(pair.effect_time, pair.effect, p, change_s)
            for pair, p in zip(pairs, points, strict=True)
        ]
    )
    starts = _block_starts(points)
    blocks = [slice(a, b) for a, b in zip(starts, [*starts[1:], count], strict=True)]
    fold = np.arange(len(blocks)) * min(_FOLDS, len(blocks)) // len(blocks)
    residual = np.empty((len(shifts), len(blocks)))
    for k, shift in enumerate(shifts):
        x = _center(
            [
                _values(pair.cause_time, pair.cause, p + shift, change_s)
                for pair, p in zip(pairs, points, strict=True)
            ]
        )
        residual[k] = block_residuals(x, effect, blocks, fold)
    return ShiftCurve(shifts, residual, float((effect**2).sum()), len(pairs) > 1)


def _values(time: Float, values: Float, at: Float, change_s: float) -> Float:
    """Return values (n, d), or their changes, at times (t,) that `_is_known` accepts: (t, d)."""
    weights = _interpolation(time, at)
    if change_s:
        weights = weights - _interpolation(time, at - change_s)
    return np.asarray(weights @ values)


def _interpolation(time: Float, at: Float) -> sp.csr_array:
    """Return the matrix (t, n) that interpolates linearly between the n times of samples."""
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    x = np.clip((at - time[after - 1]) / (time[after] - time[after - 1]), 0.0, 1.0)
    weights, samples = np.stack([1 - x, x], axis=1), np.stack([after - 1, after], axis=1)
    rows = np.arange(0, 2 * len(at) + 1, 2)
    return sp.csr_array((weights.ravel(), samples.ravel(), rows), (len(at), len(time)))


def _is_known(time: Float, at: Float) -> Bool:
    """Return which times (...) have samples on both sides, not too far apart."""
    one = interpolate_at(at.ravel(), time, np.ones((len(time), 1)), _MAX_GAP_S)
    return np.asarray(np.isfinite(one).reshape(at.shape))


def _center(parts: Sequence[Float]) -> Float:
    """Join recordings (t, d), each without its mean: resistances at rest differ between them."""
    return np.concatenate([part - part.mean(axis=0) for part in parts if len(part)])


def _common_points(pair: Pair, shifts: Float, change_s: float) -> Float:
    """Return the times of the effects that have causes at all shifts."""
    time = pair.effect_time
    stride = max(len(time) // (2 * _MAX_POINTS), 1)
    time = time[::stride]
    is_known = np.ones(len(time), bool)
    for before in (time, time - change_s) if change_s else (time,):
        is_known &= _is_known(pair.effect_time, before)
        for some in np.array_split(shifts, -(-len(shifts) // _SHIFTS_AT_ONCE)):
            is_known &= _is_known(pair.cause_time, before + some[:, None]).all(axis=0)
    return time[is_known]


def _block_starts(points: Sequence[Float]) -> list[int]:
    """Return the first index of each block of the joined points; a block has one recording."""
    spans = [float(np.ptp(p)) if len(p) else 0.0 for p in points]
    length = max(_MIN_BLOCK_S, sum(spans) / _MAX_BLOCKS)
    starts, first = list[int](), 0
    for p, span in zip(points, spans, strict=True):
        number = max(min(int(span / length), len(p)), min(len(p), 1))
        starts += [first + len(p) * k // number for k in range(number)]
        first += len(p)
    return starts


def block_residuals(x: Float, y: Float, blocks: Sequence[slice], fold: Int) -> Float:
    """Return sums of squares (blocks,) of y (t, o) that fits of the other folds leave."""
    size = x.std(axis=0)
    x = x / np.where(size > 0, size, 1.0)
    gram = np.stack([x[b].T @ x[b] for b in blocks])
    cross = np.stack([x[b].T @ y[b] for b in blocks])
    square = np.array([(y[b] ** 2).sum() for b in blocks])
    ridge = _RIDGE * len(x) * np.eye(x.shape[1])
    out = np.empty(len(blocks))
    for f in range(int(fold.max()) + 1):
        left_out = fold == f
        w = np.linalg.solve(gram[~left_out].sum(0) + ridge, cross[~left_out].sum(0))
        fitted = ((gram[left_out] @ w - 2 * cross[left_out]) * w).sum(axis=(1, 2))
        out[left_out] = square[left_out] + fitted
    return np.maximum(out, 0.0)
