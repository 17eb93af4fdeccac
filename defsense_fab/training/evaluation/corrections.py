"""What a gain and an offset for each channel, and offsets that drift, would gain on test frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float, Int
from ...decoding.trained_model import Decoded, TrainedModel
from ..data.dataset import Dataset
from .decoded_frames import DecodedFrames, decode_signals
from .independent_blocks import autocorrelation_time, block_length

# By how much a correction would lessen errors that it was not fitted to.
#
# A correction with many coefficients fits whatever errors it is shown. Here it is fitted to four
# fifths of the frames, in blocks that are long beside the errors' autocorrelation time, and applied
# to the fifth that is left out, in turn; where that does not help, there is nothing to correct.

_FOLDS = 5
_ENOUGH = 0.2  # share of the frames
_LEAST_BLOCKS = 2 * _FOLDS
RIDGES = (1e-4, 1e-3, 1e-2, 1e-1)  # of features of unit spread, tried


@dataclass(frozen=True)
class Residual:
    """Errors (t, m, 3) mm, 0 in gaps, with the weights (t, m) of their squares, those that
    corrections are fitted with, `fitting` (t, m), and the fold (t,) that each frame belongs to."""

    error: Float
    weights: Float
    fitting: Float
    fold: Int

    @property
    def square(self) -> float:
        """Mean square, mm^2."""
        return float((self.weights * (self.error**2).sum(axis=2)).sum())

    def less(self, correction: Float) -> Residual:
        """After a correction (t, m, 3) mm is taken out; itself where that is no better."""
        error = np.where(self.weights[..., None] > 0, self.error - correction, 0.0)
        better = replace(self, error=error)
        return better if better.square < self.square else self


def residual_of(frames: DecodedFrames) -> Residual:
    """The errors of decoded frames. Corrections are fitted to those within the trained range, where
    they are enough: beyond it, they would take for theirs what the decoder never saw."""
    within = frames.distance <= 1
    enough = within.mean() >= _ENOUGH
    fitting = frames.weights * within[:, None] if enough else frames.weights
    return Residual(np.nan_to_num(frames.error), frames.weights, fitting, folds(frames))


def folds(frames: DecodedFrames) -> Int:
    """(t,) from 0 to 4, in turn in blocks of frames."""
    count = len(frames.time)
    wanted = block_length(autocorrelation_time(frames.per_frame, frames.run))
    length = max(min(wanted, count // _LEAST_BLOCKS), 1)
    return np.asarray(np.arange(count) // length % _FOLDS)


def by_parameters(residual: Residual, slopes: Float) -> tuple[Float, Float]:
    """The correction (t, m, 3) mm that parameters (p,) of all markers together, with `slopes`
    (t, m, 3, p), give of frames left out; and the parameters of all frames."""
    p = slopes.shape[3]
    normal = np.zeros((_FOLDS, p, p))
    right = np.zeros((_FOLDS, p))
    for k in range(_FOLDS):
        own = residual.fold == k
        here = slopes[own]
        a = (here * residual.fitting[own][..., None, None]).reshape(-1, p)
        normal[k] = a.T @ here.reshape(-1, p)
        right[k] = a.T @ residual.error[own].ravel()
    correction = np.zeros_like(residual.error)
    for k in range(_FOLDS):
        own = residual.fold == k
        correction[own] = slopes[own] @ _solved(normal.sum(0) - normal[k], right.sum(0) - right[k])
    return correction, _solved(normal.sum(0), right.sum(0))


def by_features(residual: Residual, features: Float, ridge: float) -> Float:
    """The correction (t, m, 3) mm of frames left out, linear in features (t, f), with coefficients
    for each marker. Features are brought to unit spread; none is a constant."""
    return fitted_elsewhere(residual, residual, features, features, ridge, same=True)


def fitted_elsewhere(
    residual: Residual, training: Residual, features: Float, trained: Float, ridge: float,
    same: bool = False,
) -> Float:  # fmt: skip
    """As `by_features`, fitted to all of a training residual with features (n, f) `trained`; with
    `same`, both are the same frames, and each fold is left out in turn."""
    middle, spread = trained.mean(0), trained.std(0)
    spread[spread <= 1e-12 * (1 + np.abs(middle))] = np.inf
    x, z = (features - middle) / spread, (trained - middle) / spread
    correction = np.zeros_like(residual.error)
    parts = [training.fold == k for k in range(_FOLDS)] if same else [np.ones(len(z), bool)]
    for m in range(correction.shape[1]):
        w = training.fitting[:, m]
        weighted = z * w[:, None]
        normal = np.array([weighted[p].T @ z[p] for p in parts])
        right = np.array([weighted[p].T @ training.error[p, m] for p in parts])
        weight = np.array([w[p].sum() for p in parts])
        for k in range(len(parts)):
            own = parts[k] if same else np.ones(len(x), bool)
            N, r, W = (v.sum(0) - v[k] if same else v[0] for v in (normal, right, weight))
            if W > 0:
                beta = np.linalg.solve(N + ridge * W * np.eye(x.shape[1]), r)
                correction[own, m] = x[own] @ beta
    return correction


def _solved(normal: Float, right: Float) -> Float:
    """Of least squares, where some parameters may tell nothing."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(scale, scale) + 1e-9 * np.eye(len(normal))
    return np.asarray(np.linalg.solve(scaled, right / scale) / scale)


_ROUNDS = 3  # of Gauss and Newton
_GAIN, _OFFSET = 1e-3, 1e-4  # steps of differences

#: Signals (n, c) of a run, by index and times (n,) s, to others.
Change = Callable[[int, Float, Float], Float]


def decoded_again(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, change: Change
) -> Decoded:
    """What the model makes of changed signals at the frames."""
    points, radius = np.empty_like(frames.predicted), np.empty_like(frames.radius)
    distance = np.empty_like(frames.distance)
    for k, r in enumerate(data.recordings):
        own = frames.run == k
        if own.any():
            signals = change(k, r.sample_time, r.signals)
            said = decode_signals(model, r.sample_time, signals, frames.time[own])
            points[own], radius[own], distance[own] = said.points, said.radius, said.distance
    return Decoded(points, radius, distance)


@dataclass
class ChannelCorrection:
    """Of decoded frames of a dataset that is matched to the model. First `placed`, then `drifted`,
    which starts from the gains and offsets found."""

    model: TrainedModel
    data: Dataset
    frames: DecodedFrames

    def __post_init__(self) -> None:
        self._found = np.zeros(2 * len(self.model.channels))
        self._before: Residual | None = None
        self._drift = np.zeros(0)

    def placed(self, residual: Residual) -> Float:
        """The correction (t, m, 3) mm of signals times a gain and with an offset each."""
        self._before = residual
        for _ in range(_ROUNDS):
            here = self._decoded(self._found)
            start = self._from(here)
            change, more = by_parameters(start, self._slopes(here))
            correction = change - (here - self.frames.predicted)
            self._found = self._found - more
        return np.asarray(correction)

    def drifted(self, residual: Residual) -> Float:
        """The correction beyond that of `placed`, of all together with offsets of each run, and
        their change in time; to first order."""
        assert self._before is not None
        here = self._decoded(self._found)
        slopes = np.concatenate([self._slopes(here), self._drifts(here)], axis=-1)
        change, more = by_parameters(self._from(here), slopes)
        placed, self._drift = np.split(-more, [len(self._found)])
        self._found = self._found + placed
        both = change - (here - self.frames.predicted)
        return np.asarray(both - (self._before.error - residual.error))

    @property
    def gains(self) -> Float:
        """By how much (c,) the gains that were found differ from 1."""
        return np.asarray(self._found[: len(self.model.channels)])

    def distance(self) -> Float:
        """Of the corrected signals (t,) from the trained range."""
        channels, used = len(self.model.channels), np.unique(self.frames.run).tolist()
        drift = self._drift.reshape(channels, 2, len(used))

        def corrected(k: int, time: Float, s: Float) -> Float:
            if k not in used:
                return s
            constant, line = drift[:, :, used.index(k)].T
            moved = constant + self._course(k, time)[:, None] * line
            return np.asarray(self._placed(self._found, s) + moved)

        return decoded_again(self.model, self.data, self.frames, corrected).distance

    def _course(self, run: int, time: Float) -> Float:
        """From -0.5 to 0.5 over the tested time of a run."""
        first, last = self.frames.time[self.frames.run == run][[0, -1]]
        return np.asarray((time - (first + last) / 2) / max(last - first, 1e-9))

    def _from(self, here: Float) -> Residual:
        assert self._before is not None
        return replace(self._before, error=self._before.error + here - self.frames.predicted)

    def _placed(self, parameters: Float, signals: Float) -> Float:
        gain, offset = np.split(parameters, 2)
        return np.asarray(signals * (1 + gain) + offset)

    def _decoded(self, parameters: Float) -> Float:
        return decoded_again(
            self.model, self.data, self.frames, lambda _, __, s: self._placed(parameters, s)
        ).points

    def _slopes(self, here: Float) -> Float:
        steps = np.repeat([_GAIN, _OFFSET], len(self.model.channels))
        return np.stack(
            [(self._decoded(self._found + step) - here) / step.sum() for step in np.diag(steps)],
            axis=-1,
        )

    def _drifts(self, here: Float) -> Float:
        frames, channels = self.frames, len(self.model.channels)
        slopes = []
        for one in _OFFSET * np.eye(channels):
            for order in (0, 1):

                def moved(
                    k: int, time: Float, s: Float, one: Float = one, order: int = order
                ) -> Float:
                    course = self._course(k, time)[:, None] ** order
                    return np.asarray(self._placed(self._found, s) + course * one)

                there = decoded_again(self.model, self.data, frames, moved).points
                slope = (there - here) / _OFFSET
                slopes += [slope * (frames.run == k)[:, None, None] for k in np.unique(frames.run)]
        return np.stack(slopes, axis=-1)
