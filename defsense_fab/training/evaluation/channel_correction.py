"""What a gain and an offset for each channel, and offsets that drift, would gain on test frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...decoding.trained_model import TrainedModel
from ..dataset import Dataset
from .cross_fitting import Residual, by_parameters
from .decoded_frames import DecodedFrames, decode_signals

_ROUNDS = 3  # of Gauss and Newton
_GAIN, _OFFSET = 1e-3, 1e-4  # steps of differences

#: Signals (n, c) of a run, by index and times (n,) s, to others.
Change = Callable[[int, Float, Float], Float]


def decoded_again(
    model: TrainedModel, data: Dataset, frames: DecodedFrames, change: Change
) -> Float:
    """Positions (t, m, 3) mm of changed signals."""
    out = np.empty_like(frames.predicted)
    for k, r in enumerate(data.recordings):
        own = frames.run == k
        if own.any():
            signals = change(k, r.sample_time, r.signals)
            out[own] = decode_signals(model, r.sample_time, signals, frames.time[own]).points
    return out


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
        self._done = np.zeros_like(self.frames.predicted)

    def placed(self, residual: Residual) -> Float:
        """The correction (t, m, 3) mm of signals times a gain and with an offset each."""
        self._before = residual
        for _ in range(_ROUNDS):
            here = self._decoded(self._found)
            start = self._from(here)
            change, more = by_parameters(start, self._slopes(here))
            self._done = change - (here - self.frames.predicted)
            self._found = self._found - more
        return self._done

    def drifted(self, residual: Residual) -> Float:
        """The correction beyond that of `placed`, of all together with offsets of each run, and
        their change in time; to first order."""
        assert self._before is not None
        here = self._decoded(self._found)
        slopes = np.concatenate([self._slopes(here), self._drifts(here)], axis=-1)
        change, _ = by_parameters(self._from(here), slopes)
        both = change - (here - self.frames.predicted)
        return np.asarray(both - (self._before.error - residual.error))

    def _from(self, here: Float) -> Residual:
        assert self._before is not None
        return replace(self._before, error=self._before.error + here - self.frames.predicted)

    def _placed(self, parameters: Float, signals: Float) -> Float:
        gain, offset = np.split(parameters, 2)
        return np.asarray(signals * (1 + gain) + offset)

    def _decoded(self, parameters: Float) -> Float:
        return decoded_again(
            self.model, self.data, self.frames, lambda _, __, s: self._placed(parameters, s)
        )

    def _slopes(self, here: Float) -> Float:
        steps = np.repeat([_GAIN, _OFFSET], len(self.model.channels))
        return np.stack(
            [(self._decoded(self._found + step) - here) / step.sum() for step in np.diag(steps)],
            axis=-1,
        )

    def _drifts(self, here: Float) -> Float:
        frames, channels = self.frames, len(self.model.channels)
        used = np.unique(frames.run)
        span = {k: frames.time[frames.run == k][[0, -1]] for k in used}
        slopes = []
        for one in _OFFSET * np.eye(channels):
            for order in (0, 1):

                def moved(
                    k: int, time: Float, s: Float, one: Float = one, order: int = order
                ) -> Float:
                    first, last = span[k]
                    course = (time - (first + last) / 2) / max(last - first, 1e-9)
                    return np.asarray(self._placed(self._found, s) + course[:, None] ** order * one)

                slope = (decoded_again(self.model, self.data, frames, moved) - here) / _OFFSET
                slopes += [slope * (frames.run == k)[:, None, None] for k in used]
        return np.stack(slopes, axis=-1)
