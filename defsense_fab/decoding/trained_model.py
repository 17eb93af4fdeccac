"""A trained model: from the signals of the cords to the positions of the markers, with intervals.

The signals (R - R0)/R0 are corrected by each channel's gain and offset. Their memories are added
(`signal_history.py`), features of these are computed (polynomials or radial basis functions), and
linear weights map the features to positions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ..core.arrays import Bool, Float, Int
from ..core.errors import TrainingError
from .channel_faults import FaultLimits
from .input_decoder import InputDecoder, SharedMemory
from .quantities import MARKER_UNIT, Readings, Targets
from .signal_history import Past, PastStream, interpolate_at

UNTRAINED_DISTANCE = 1.5  # of signals; 1 % of the training's own readings are beyond 1


@dataclass(frozen=True)
class Intervals:
    """Conformal intervals of the positions.

    With probability `level`, a marker is within `radius` of its decoded position, while the inputs
    are no farther from the training than the frames were on which that was measured. Beyond, the
    radius grows with the square of the distance.

    Attributes:
        level: The probability.
        radius: Radius of each marker (m,), mm.
        reach: Distance of the inputs from the training beyond which the radius grows.
    """

    level: float
    radius: Float
    reach: float

    def select(self, which: Bool) -> Intervals:
        """Return the intervals of the markers of a mask (m,)."""
        return Intervals(self.level, self.radius[which], self.reach)

    def trust(self, distance: Float) -> Float:
        """Return 1 within reach, and less with the square of the distance (t,) beyond."""
        return np.asarray(np.maximum(distance / self.reach, 1.0) ** -2)

    def __call__(self, distance: Float) -> Float:
        """Return the radii (t, m) in mm at distances (t,)."""
        return np.asarray(self.radius / self.trust(distance)[:, None])


@dataclass(frozen=True)
class TrainedRange:
    """Range of a decoder's inputs z in training.

    The distance of inputs from the training is sqrt(mean(((z - middle) whiten)^2)), in units of
    `usual`.

    Attributes:
        middle: Center of the inputs (d,).
        whiten: Matrix (d, d) that whitens them.
        usual: Distance below which 99 % of the training's inputs are.
        low: Lowest signals (c,).
        high: Highest signals (c,).
    """

    middle: Float
    whiten: Float
    usual: float
    low: Float
    high: Float

    def distance(self, inputs: Float) -> Float:
        """Return the distances (t,) of inputs (t, d); above 1 is outside of the training."""
        whitened = (inputs - self.middle) @ self.whiten
        return np.asarray(np.sqrt((whitened**2).mean(axis=1)) / self.usual)

    def for_signals(self) -> TrainedRange:
        """Return the range of the signals alone, the first c inputs, without their memories."""
        c = len(self.low)
        covariance = np.linalg.inv(self.whiten @ self.whiten.T)[:c, :c]
        values, vectors = np.linalg.eigh(covariance)
        return TrainedRange(
            self.middle[:c], vectors / np.sqrt(values), self.usual, self.low, self.high
        )


@dataclass(frozen=True)
class Branch:
    """A decoder of some of the channels.

    Attributes:
        channels: Indices of the channels (k,).
        past: Memories that are inputs, too.
        decoder: The decoder.
        range: Range of its inputs in training.
        intervals: Intervals of its positions; None where they are not known.
        simulated: A simulated map; positions are then the sum of its outputs and the decoder's.
        outside: An affine decoder of the k signals without memories. Beyond the reach of the
            intervals it gradually replaces a nonlinear decoder, which is unreliable there. None if
            the decoder is affine, or there is a simulated map.
    """

    channels: tuple[int, ...]
    past: Past
    decoder: InputDecoder
    range: TrainedRange
    intervals: Intervals | None
    simulated: SharedMemory | None = None
    outside: InputDecoder | None = None

    @cached_property
    def signal_range(self) -> TrainedRange:
        """Range of the signals in training, without their memories."""
        return self.range.for_signals()

    def signal_distance(self, inputs: Float) -> float:
        """Return the distance of the signals among inputs (d,) from the training."""
        return float(self.signal_range.distance(inputs[None, : len(self.channels)])[0])

    def inputs(self, time: Float, signals: Float) -> Float:
        """Return the inputs (t, d) of all corrected signals (t, c) at times (t,), s."""
        return self.past(time, signals[:, list(self.channels)])

    def positions(self, inputs: Float) -> Float:
        """Return the outputs (t, o) in mm of inputs (t, d)."""
        outputs = self.decoder(inputs)
        if self.simulated is not None:
            return outputs + self.simulated(inputs)
        if self.outside is None or self.intervals is None:
            return outputs
        trust = self.intervals.trust(self.range.distance(inputs))[:, None]
        if (trust == 1).all():
            return outputs
        signals = inputs[:, : len(self.channels)]
        return np.asarray(trust * outputs + (1 - trust) * self.outside(signals))

    def select_targets(self, which: Bool) -> Branch:
        """Return the decoder of the targets of a mask (m,), without a simulated map."""
        columns = np.repeat(which, len(self.decoder.constant) // len(which))
        return replace(
            self,
            decoder=self.decoder.select(columns),
            intervals=None if self.intervals is None else self.intervals.select(which),
            simulated=None,
            outside=None if self.outside is None else self.outside.select(columns),
        )

    def decode_sample(self, inputs: Float) -> Float:
        """Return the outputs (o,) in mm of one sample (d,)."""
        if self.outside is not None:
            return np.asarray(self.positions(inputs[None])[0])
        outputs = self.decoder.decode_sample(inputs)
        if self.simulated is None:
            return outputs
        return outputs + self.simulated.decode_sample(inputs)


@dataclass(frozen=True)
class Decoded:
    """Decoded positions.

    Attributes:
        points: Positions (t, m, 3) in the rest frame, mm.
        radius: Radii of their intervals (t, m), mm; NaN where there are none.
        distance: Distances (t,) from the training.
    """

    points: Float
    radius: Float
    distance: Float


@dataclass(frozen=True)
class TrainedModel:
    """A model as in `model.json`.

    Attributes:
        device: Name of the device.
        layout: Hash of the layout of its cords.
        kind: Name of the decoder.
        channels: Names of the channels (c,).
        ids: Numbers of the markers (m,).
        rest_points: Positions of the markers at rest (m, 3), mm.
        gain: Gain of each channel (c,).
        offset: Offset of each channel (c,); a corrected signal is (s - offset) / gain.
        main: Decoder of all channels.
        without: Decoders without one channel, by that channel's name.
        faults: Limits that show when a channel has failed.
        poses: Signals (c,) at the extreme of each pose.
        pose_spread: Difference of the signals between repetitions of a pose, where it is known.
        metadata: Facts on the training in plain values: folds, hashes, versions, units.
        targets: Names and units of the targets; None for markers, whose positions are in mm.
        readings: Units and reference of the channels; None for resistances of a device's cords.
    """

    SCHEMA: ClassVar[int] = 2

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
    metadata: Mapping[str, Any] = field(default_factory=dict)
    targets: Targets | None = None
    readings: Readings | None = None

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the m targets; mm for markers."""
        return (MARKER_UNIT,) * len(self.ids) if self.targets is None else self.targets.units

    @property
    def target_names(self) -> tuple[str, ...]:
        """Names of the m targets; numbers for markers."""
        if self.targets is None:
            return tuple(str(i) for i in self.ids.tolist())
        return self.targets.names

    def correct(self, signals: Float) -> Float:
        """Return signals (..., c) without each channel's offset and gain."""
        return np.asarray((signals - self.offset) / self.gain)

    def branch(self, lost: str | None = None) -> Branch:
        """Return the decoder to use.

        Args:
            lost: Name of a channel that has failed.

        Returns:
            The decoder of all channels, or the one without the failed channel.

        Raises:
            TrainingError: The model has no decoder without that channel.
        """
        if lost is None:
            return self.main
        if lost not in self.without:
            available = ", ".join(self.without) or "no channel"
            raise TrainingError(
                f"there is no decoder without the channel {lost}",
                code="no-decoder-without",
                where="model",
                action=f"Use one without {available}, or train the model again",
                channel=lost,
            )
        return self.without[lost]

    def decode(self, time: Float, signals: Float, at: Float, lost: str | None = None) -> Decoded:
        """Decode a recording.

        Args:
            time: Times of the samples (n,), s.
            signals: Signals (n, c), (R - R0)/R0.
            at: Times of the result (t,), s.
            lost: Name of a channel that has failed.

        Returns:
            Positions, linear between samples; NaN where no sample is close.

        Raises:
            TrainingError: The model has no decoder without that channel.
        """
        branch = self.branch(lost)
        z = interpolate_at(at, time, branch.inputs(time, self.correct(signals)))
        return decode_inputs(branch, z, len(self.ids))

    def select_targets(self, which: Bool) -> TrainedModel:
        """Return the model of the targets or markers of a mask (m,), without simulated maps."""
        return replace(
            self,
            ids=self.ids[which],
            rest_points=self.rest_points[which],
            main=self.main.select_targets(which),
            without={name: branch.select_targets(which) for name, branch in self.without.items()},
            targets=None if self.targets is None else self.targets.select(which),
        )

    def stream(self, lost: str | None = None) -> ModelStream:
        """Return a decoder for samples as they arrive; see `branch` for `lost`."""
        return ModelStream(self, self.branch(lost))


class ModelStream:
    """Decodes one sample at a time.

    Args:
        model: The model.
        branch: Its decoder to use.
    """

    def __init__(self, model: TrainedModel, branch: Branch) -> None:
        self._model, self._branch = model, branch
        self._past = PastStream(branch.past, len(branch.channels))
        self._channels = np.array(branch.channels)

    def __call__(self, time: float, signals: Float) -> Float:
        """Return the positions (m, 3) in mm of signals (c,) at a time in s."""
        return self._branch.decode_sample(self.inputs(time, signals)).reshape(
            len(self._model.ids), -1
        )

    def change_rest(self, ratio: Float) -> None:
        """Continue with other resistances at rest.

        The memories are converted, so that the change does not count as movement.

        Args:
            ratio: Former resistance at rest over the new one (c,).
        """
        offset, gain = self._model.offset[self._channels], self._model.gain[self._channels]
        k = ratio[self._channels]
        self._past.rescale(k, (1 + offset) * (k - 1) / gain)

    def inputs(self, time: float, signals: Float) -> Float:
        """Return the decoder's inputs (d,) for signals (c,) at a time in s."""
        s = self._model.correct(signals)[self._channels]
        return self._past(time, s) if self._branch.past.count else s


def decode_inputs(branch: Branch, inputs: Float, markers: int) -> Decoded:
    """Decode inputs.

    Args:
        branch: The decoder.
        inputs: Inputs (t, d).
        markers: Number of markers m.

    Returns:
        Positions with their intervals.
    """
    outputs = branch.positions(inputs)
    points = outputs.reshape(len(inputs), markers, outputs.shape[1] // markers)
    distance = branch.range.distance(inputs)
    if branch.intervals is None:
        return Decoded(points, np.full(points.shape[:2], np.nan), distance)
    return Decoded(points, branch.intervals(distance), distance)
