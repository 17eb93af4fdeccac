"""What a gain and an offset for each channel, and offsets that drift, would gain on test frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...decoding.trained_model import Decoded, TrainedModel
from ..data.dataset import Dataset
from .cross_fitting import Residual, by_parameters
from .decoded_frames import DecodedFrames, decode_signals

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
