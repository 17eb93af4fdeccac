"""A trained model: from what the cords say to where the markers are, and how wrong that may be.

signals (R - R0)/R0, corrected by each channel's gain and offset -> their past (`past.py`) ->
features (polynomial, or radial basis functions) -> ridge weights -> marker positions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ..core.arrays import Float, Int
from ..core.errors import TrainingError
from .channel_faults import FaultLimits
from .input_decoder import InputDecoder, SharedMemory
from .signal_history import Past, PastStream, at_times


@dataclass(frozen=True)
class Intervals:
    """Conformal: with the probability `level` a marker lies within radius (t, m) mm of where it is
    said to be; radius = `factor` (m,) * (`spread` (m,) mm + `slope` (m,) mm * distance), of the
    distance (t,) of what the cords say from what was trained on."""

    level: float
    factor: Float
    spread: Float
    slope: Float

    def __call__(self, distance: Float) -> Float:
        """(t, m) mm of distances (t,)."""
        return np.asarray(self.factor * (self.spread + self.slope * distance[:, None]))


@dataclass(frozen=True)
class TrainedRange:
    """What the decoder's inputs z (d,) were in training: distance = sqrt(mean(w^2)) of what
    z, less `middle` (d,), is in the directions and units `whiten` (d, d); `usual` is the distance
    that 99 % of the training's stayed under, `low` and `high` (c,) are the signals' own range."""

    middle: Float
    whiten: Float
    usual: float
    low: Float
    high: Float

    def distance(self, inputs: Float) -> Float:
        """(t,) of inputs (t, d), in units of `usual`: above 1 lies outside of the training."""
        away = (inputs - self.middle) @ self.whiten
        return np.asarray(np.sqrt((away**2).mean(axis=1)) / self.usual)

    def of_signals(self) -> TrainedRange:
        """The same of the signals alone, the first c of the inputs, without what is remembered of
        them."""
        c = len(self.low)
        covariance = np.linalg.inv(self.whiten @ self.whiten.T)[:c, :c]
        values, vectors = np.linalg.eigh(covariance)
        return TrainedRange(
            self.middle[:c], vectors / np.sqrt(values), self.usual, self.low, self.high
        )


@dataclass(frozen=True)
class Branch:
    """A decoder of some of the `channels`, by index (k,), with the past that it sees, the range
    that it was trained in, and its intervals (None: not known). Where there is a `simulated` map,
    positions are its own and the decoder's together."""

    channels: tuple[int, ...]
    past: Past
    decoder: InputDecoder
    range: TrainedRange
    intervals: Intervals | None
    simulated: SharedMemory | None = None

    def inputs(self, time: Float, signals: Float) -> Float:
        """z (t, d) of all signals (t, c) at times (t,) s."""
        return self.past(time, signals[:, list(self.channels)])

    def positions(self, inputs: Float) -> Float:
        """(t, o) mm of inputs (t, d)."""
        found = self.decoder(inputs)
        return found if self.simulated is None else found + self.simulated(inputs)

    def one(self, inputs: Float) -> Float:
        """(o,) mm of one sample's inputs (d,)."""
        found = self.decoder.one(inputs)
        return found if self.simulated is None else found + self.simulated.one(inputs)


@dataclass(frozen=True)
class Decoded:
    """Positions (t, m, 3) mm in the rest frame, the radius (t, m) mm of their intervals (NaN where
    there are none), and the distance (t,) from what was trained on."""

    points: Float
    radius: Float
    distance: Float


@dataclass(frozen=True)
class TrainedModel:
    """`kind` names the decoder; `channels` by name, markers by their numbers `ids` (m,), their
    places at rest (m, 3) mm. `gain` and `offset` (c,) correct the signals: s -> (s - offset)/gain.
    The `main` branch uses all channels, `without` has one for each channel that may fail; `faults`
    tells when one has; `poses` are the signals (c,) at the extreme of each pose, `pose_spread` what
    they differ by from one show to another, where known. `told` is what there is to know of the
    training, in plain values: folds, hashes, versions, units."""

    SCHEMA: ClassVar[int] = 1

    device: str
    layout: str
    kind: str
    channels: tuple[str, ...]
    ids: Int
    rest_points: Float
    gain: Float
    offset: Float
    main: Branch
    without: Mapping[str, Branch] = field(default_factory=dict)
    faults: FaultLimits | None = None
    poses: Mapping[str, Float] = field(default_factory=dict)
    pose_spread: Mapping[str, float] = field(default_factory=dict)
    told: Mapping[str, Any] = field(default_factory=dict)

    def corrected(self, signals: Float) -> Float:
        """Signals (..., c) with each channel's offset and gain taken out."""
        return np.asarray((signals - self.offset) / self.gain)

    def branch(self, lost: str | None = None) -> Branch:
        """The decoder to use, or that without a channel. Raises TrainingError where there is none
        for that."""
        if lost is None:
            return self.main
        if lost not in self.without:
            raise TrainingError(
                f"the model has no decoder without {lost}; it has those without"
                f" {', '.join(self.without) or 'none'}",
                code="no-decoder-without",
                channel=lost,
            )
        return self.without[lost]

    def decode(self, time: Float, signals: Float, at: Float, lost: str | None = None) -> Decoded:
        """Of signals (n, c) sampled at times (n,) s, at the times `at` (t,) s: linear between
        samples, NaN where there are none near."""
        branch = self.branch(lost)
        z = at_times(at, time, branch.inputs(time, self.corrected(signals)))
        return decoded(branch, z, len(self.ids))

    def stream(self, lost: str | None = None) -> ModelStream:
        """The same for samples as they come."""
        return ModelStream(self, self.branch(lost))


class ModelStream:
    """Decodes a sample at a time."""

    def __init__(self, model: TrainedModel, branch: Branch) -> None:
        self._model, self._branch = model, branch
        self._past = PastStream(branch.past, len(branch.channels))
        self._pick = np.array(branch.channels)

    def __call__(self, time: float, signals: Float) -> Float:
        """Positions (m, 3) mm of the signals (c,) at a time, s."""
        return self._branch.one(self.inputs(time, signals)).reshape(-1, 3)

    def refer(self, ratio: Float) -> None:
        """R0 is from now on the former one over `ratio` (c,): what is remembered refers to it, too,
        so that it counts as no movement."""
        offset, gain = self._model.offset[self._pick], self._model.gain[self._pick]
        k = ratio[self._pick]
        self._past.rescale(k, (1 + offset) * (k - 1) / gain)

    def inputs(self, time: float, signals: Float) -> Float:
        """What the decoder sees (d,) of the same."""
        s = self._model.corrected(signals)[self._pick]
        return self._past(time, s) if self._branch.past.count else s


def decoded(branch: Branch, inputs: Float, markers: int) -> Decoded:
    """Of inputs (t, d)."""
    points = branch.positions(inputs).reshape(len(inputs), markers, 3)
    distance = branch.range.distance(inputs)
    if branch.intervals is None:
        return Decoded(points, np.full(points.shape[:2], np.nan), distance)
    return Decoded(points, branch.intervals(distance), distance)
