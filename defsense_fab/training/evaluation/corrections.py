"""How much corrections would reduce errors on frames that they were not fitted to.

A correction with many coefficients fits any errors. So each is fitted to four fifths of the frames,
in blocks that are long compared with the errors' autocorrelation time, and applied to the remaining
fifth, in turn. If this does not help, there is nothing to correct.

Corrections are linear functions of features, or changes of the signals: a gain and an offset of
each channel, and offsets that drift.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Bool, Float, Int
from ...decoding.trained_model import Decoded, TrainedModel
from ..data.dataset import Dataset
from .decoded_frames import DecodedFrames, decode_signals
from .independent_blocks import autocorrelation_time, block_length

#: Ridges to try, for features with a standard deviation of 1.
RIDGES = (1e-4, 1e-3, 1e-2, 1e-1)

#: Function of a run's index, sample times (n,) s and signals (n, c) that returns changed signals.
SignalChange = Callable[[int, Float, Float], Float]

_FOLDS = 5
_MIN_INSIDE_SHARE = 0.2  # of the frames within the trained range, to fit to those alone
_MIN_BLOCKS = 2 * _FOLDS
_NEWTON_ROUNDS = 3  # of Gauss-Newton
_GAIN_STEP, _OFFSET_STEP = 1e-3, 1e-4  # of finite differences


@dataclass(frozen=True)
class Residual:
    """Remaining errors of frames.

    Attributes:
        error: Errors, shape (t, m, 3), mm; 0 in gaps.
        weights: Weights of the squared errors, shape (t, m).
        fitting: Weights with which corrections are fitted, shape (t, m).
        fold: Fold of each frame, shape (t,).
    """

    error: Float
    weights: Float
    fitting: Float
    fold: Int

    @property
    def square(self) -> float:
        """Mean square error, mm^2."""
        return float((self.weights * (self.error**2).sum(axis=2)).sum())

    def reduced_by(self, correction: Float) -> Residual:
        """Subtract a correction (t, m, 3) mm; return this residual if that is no better."""
        error = np.where(self.weights[..., None] > 0, self.error - correction, 0.0)
        reduced = replace(self, error=error)
        return reduced if reduced.square < self.square else self


def residual_of(frames: DecodedFrames) -> Residual:
    """Return the errors of decoded frames, with folds and weights.

    Corrections are fitted to frames within the trained range, if there are enough. Beyond it, they
    would explain poses that the decoder was never trained on.

    Args:
        frames: The decoded frames.

    Returns:
        The residual.
    """
    is_inside = frames.is_inside
    has_enough = is_inside.mean() >= _MIN_INSIDE_SHARE
    fitting = frames.weights * is_inside[:, None] if has_enough else frames.weights
    return Residual(
        np.nan_to_num(frames.error), frames.weights, fitting, _assign_block_folds(frames)
    )


def _assign_block_folds(frames: DecodedFrames) -> Int:
    """Return the fold (t,) of each frame, from 0 to 4, in turn in blocks of frames."""
    count = len(frames.time)
    independent = block_length(autocorrelation_time(frames.frame_error, frames.run))
    length = max(min(independent, count // _MIN_BLOCKS), 1)
    return np.asarray(np.arange(count) // length % _FOLDS)


def _fit_parameters(residual: Residual, slopes: Float) -> tuple[Float, Float]:
    """Fit parameters that all markers share.

    Args:
        residual: The errors to explain.
        slopes: Slopes of the positions by the p parameters, shape (t, m, 3, p).

    Returns:
        The correction of each fold by the parameters of the others, shape (t, m, 3), mm, and the
        parameters of all frames, shape (p,).
    """
    p = slopes.shape[3]
    normal = np.zeros((_FOLDS, p, p))
    right = np.zeros((_FOLDS, p))
    for k in range(_FOLDS):
        test = residual.fold == k
        fold_slopes = slopes[test]
        a = (fold_slopes * residual.fitting[test][..., None, None]).reshape(-1, p)
        normal[k] = a.T @ fold_slopes.reshape(-1, p)
        right[k] = a.T @ residual.error[test].ravel()
    correction = np.zeros_like(residual.error)
    for k in range(_FOLDS):
        test = residual.fold == k
        parameters = _solve(normal.sum(0) - normal[k], right.sum(0) - right[k])
        correction[test] = slopes[test] @ parameters
    return correction, _solve(normal.sum(0), right.sum(0))


def fit_features(residual: Residual, features: Float, ridge: float) -> Float:
    """Fit a linear function of features for each marker.

    Args:
        residual: The errors to explain.
        features: Features of the frames, shape (t, f), none of them constant.
        ridge: Ridge, for features scaled to a standard deviation of 1.

    Returns:
        The correction of each fold by the fit to the others, shape (t, m, 3), mm.
    """
    center, spread = features.mean(0), features.std(0)
    spread[spread <= 1e-12 * (1 + np.abs(center))] = np.inf
    x = (features - center) / spread
    folds: list[Bool] = [np.asarray(residual.fold == k) for k in range(_FOLDS)]
    correction = np.zeros_like(residual.error)
    for m in range(correction.shape[1]):
        w = residual.fitting[:, m]
        weighted = x * w[:, None]
        normal = np.array([weighted[f].T @ x[f] for f in folds])
        right = np.array([weighted[f].T @ residual.error[f, m] for f in folds])
        weight = np.array([w[f].sum() for f in folds])
        for k, test in enumerate(folds):
            N, r, W = (v.sum(0) - v[k] for v in (normal, right, weight))
            if W > 0:
                beta = np.linalg.solve(N + ridge * W * np.eye(x.shape[1]), r)
                correction[test, m] = x[test] @ beta
    return correction


def _solve(normal: Float, right: Float) -> Float:
    """Solve least squares in which some parameters may have no effect."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(scale, scale) + 1e-9 * np.eye(len(normal))
    return np.asarray(np.linalg.solve(scaled, right / scale) / scale)


def decode_changed(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, change: SignalChange
) -> Decoded:
    """Decode changed signals at frames.

    Args:
        model: The model.
        data: The dataset, matched to the model.
        frames: The frames.
        change: The change of the signals.

    Returns:
        Positions, intervals and distances at the frames.
    """
    points, radius = np.empty_like(frames.predicted), np.empty_like(frames.radius)
    distance = np.empty_like(frames.distance)
    for k, r in enumerate(data.recordings):
        is_in_run = frames.run == k
        if is_in_run.any():
            signals = change(k, r.sample_time, r.signals)
            output = decode_signals(model, r.sample_time, signals, frames.time[is_in_run])
            points[is_in_run], radius[is_in_run] = output.points, output.radius
            distance[is_in_run] = output.distance
    return Decoded(points, radius, distance)


@dataclass
class ChannelCorrection:
    """Correction of gains, offsets and drift of the channels.

    Call `correct_gains` first, then `correct_drift`, which starts from the gains and offsets found.

    Attributes:
        model: The model.
        data: The dataset, matched to the model.
        frames: Its decoded frames.
    """

    model: TrainedModel
    data: Dataset
    frames: DecodedFrames

    def __post_init__(self) -> None:
        self._parameters = np.zeros(2 * len(self.model.channels))  # gains - 1, then offsets
        self._initial: Residual | None = None
        self._drift = np.zeros(0)

    def correct_gains(self, residual: Residual) -> Float:
        """Fit a gain and an offset of each channel; return the correction (t, m, 3) mm."""
        self._initial = residual
        for _ in range(_NEWTON_ROUNDS):
            points = self._decode(self._parameters)
            start = self._residual_at(points)
            change, step = _fit_parameters(start, self._slopes(points))
            correction = change - (points - self.frames.predicted)
            self._parameters = self._parameters - step
        return np.asarray(correction)

    def correct_drift(self, residual: Residual) -> Float:
        """Fit gains and offsets with offsets of each run that change linearly in time.

        The fit is to first order. Returns the correction (t, m, 3) mm beyond that of
        `correct_gains`.
        """
        assert self._initial is not None
        points = self._decode(self._parameters)
        slopes = np.concatenate([self._slopes(points), self._drift_slopes(points)], axis=-1)
        change, step = _fit_parameters(self._residual_at(points), slopes)
        gains, self._drift = np.split(-step, [len(self._parameters)])
        self._parameters = self._parameters + gains
        both = change - (points - self.frames.predicted)
        return np.asarray(both - (self._initial.error - residual.error))

    @property
    def gains(self) -> Float:
        """Differences of the fitted gains from 1, shape (c,)."""
        return np.asarray(self._parameters[: len(self.model.channels)])

    def distance(self) -> Float:
        """Return the distance (t,) of the corrected signals from the trained range."""
        channels, runs = len(self.model.channels), np.unique(self.frames.run).tolist()
        drift = self._drift.reshape(channels, 2, len(runs))

        def correct(k: int, time: Float, signals: Float) -> Float:
            if k not in runs:
                return signals
            constant, line = drift[:, :, runs.index(k)].T
            offset = constant + self._run_progress(k, time)[:, None] * line
            return np.asarray(self._apply(self._parameters, signals) + offset)

        return decode_changed(self.model, self.data, self.frames, correct).distance

    def _run_progress(self, run: int, time: Float) -> Float:
        """Return the position of times in the tested part of a run, from -0.5 to 0.5."""
        first, last = self.frames.time[self.frames.run == run][[0, -1]]
        return np.asarray((time - (first + last) / 2) / max(last - first, 1e-9))

    def _residual_at(self, points: Float) -> Residual:
        assert self._initial is not None
        error = self._initial.error + points - self.frames.predicted
        return replace(self._initial, error=error)

    def _apply(self, parameters: Float, signals: Float) -> Float:
        gain, offset = np.split(parameters, 2)
        return np.asarray(signals * (1 + gain) + offset)

    def _decode(self, parameters: Float) -> Float:
        return decode_changed(
            self.model, self.data, self.frames, lambda _, __, s: self._apply(parameters, s)
        ).points

    def _slopes(self, points: Float) -> Float:
        """Return slopes of the positions by gains and offsets, by finite differences."""
        steps = np.repeat([_GAIN_STEP, _OFFSET_STEP], len(self.model.channels))
        return np.stack(
            [
                (self._decode(self._parameters + step) - points) / step.sum()
                for step in np.diag(steps)
            ],
            axis=-1,
        )

    def _drift_slopes(self, points: Float) -> Float:
        """Return slopes of the positions by constant and linear offsets of each run."""
        frames, channels = self.frames, len(self.model.channels)
        slopes = []
        for step in _OFFSET_STEP * np.eye(channels):
            for order in (0, 1):

                def shift(
                    k: int, time: Float, s: Float, step: Float = step, order: int = order
                ) -> Float:
                    factor = self._run_progress(k, time)[:, None] ** order
                    return np.asarray(self._apply(self._parameters, s) + factor * step)

                shifted = decode_changed(self.model, self.data, frames, shift).points
                slope = (shifted - points) / _OFFSET_STEP
                slopes += [slope * (frames.run == k)[:, None, None] for k in np.unique(frames.run)]
        return np.stack(slopes, axis=-1)
