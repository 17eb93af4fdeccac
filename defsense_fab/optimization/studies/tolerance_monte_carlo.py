"""Predict how the errors of built devices scatter, by Monte Carlo over manufacturing tolerances.

Each draw is one device. Its cords lie off the axes of their grooves, differ in their response and
are longer or shorter between their ends than designed, and its poses do not reach the full
amplitude. Its decoder is the best for its signals and their noise, which long training converges
to, and is tested on a session of noisy frames of other states.

The error after training also contains the memory of the cords: the same devices are tested with
signals that are off by what a trained decoder leaves of it (`sensing/memory_residual.py`), with
decoders that are fitted to signals of that precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float, Int
from ...decoding.decoders import AnyDecoder, fit_decoder
from ...decoding.expected_errors import UnseenStates
from ...sensing.built_cord import BuiltCord, CordReading
from ...sensing.memory_residual import MemoryResidual
from ..problem.problem import Problem, reduce_outputs

_WANDER_KNOTS = 5  # points along a path between which a cord wanders in its groove
_STRAIGHT_RTOL = 1e-6  # of its length, by which a straight path may leave its line
_MEMORY_SEED = 54
_SESSION_ROWS = 40  # training rows that a session's states are repeated in
_MIN_LOOSE_LENGTH_MM = 1.0  # of a held cord between its ends
_MIN_RESISTANCE_FACTOR = 0.1  # of a built trace; a normal distribution has no lower limit


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of built devices.

    Attributes:
        offset: Largest distance of a cord from its groove's axis, in the plane and across it, mm.
        gauge: Relative standard deviation of the cords' gauge factors.
        amplitude: Relative standard deviation of the poses' amplitudes.
        ends: Standard deviation of a held cord's loose length between its ends, mm: where it is
            crimped and where its ferrules are placed.
        compression: Largest share of its slope that a response may lack below zero strain.
        frames: Number of frames of the test.
        resistance: Relative standard deviation of the cords' resistances at rest, which noise
            depends on; known only of printed traces.
    """

    offset: float = 0.3
    gauge: float = 0.05
    amplitude: float = 0.05
    ends: float = 0.7  # assumed: 0.5 mm at each of two ends
    compression: float = 0.5
    frames: int = 600
    resistance: float = 0.0


@dataclass(frozen=True)
class ToleranceBand:
    """RMSE (mm) of built devices on the tested states.

    Attributes:
        median: Median of all devices.
        low: Lower limit of the central 90 %.
        high: Upper limit.
    """

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, errors: Float) -> ToleranceBand:
        """Return the band of the errors (d,) mm of devices."""
        low, median, high = np.quantile(errors, [0.05, 0.5, 0.95])
        return cls(float(median), float(low), float(high))


@dataclass(frozen=True)
class SampledDevice:
    """One built device, and a test session whose frames show the tested states at random.

    Attributes:
        signals: Signals (n, c) in all states.
        outputs: Outputs (n, o) in all states, mm.
        noise: Standard deviations of the signals (c,) that decoders are fitted for.
        states: State of each frame (f,), by index.
        readings: Signals (f, c) that are read in the frames.
    """

    signals: Float
    outputs: Float
    noise: Float
    states: Int
    readings: Float

    def add_memory(self, memory: MemoryResidual, rng: np.random.Generator) -> SampledDevice:
        """Return the device with what is left of its cords' memory in the signals.

        Args:
            memory: Errors that the cords' memory leaves.
            rng: Random generator.
        """
        error = memory.draw(np.abs(self.signals).max(axis=0), rng)
        readings = self.readings + error * rng.normal(size=self.readings.shape)
        return replace(self, noise=np.hypot(self.noise, error), readings=readings)


def sample_devices(
    problem: Problem,
    cords: Sequence[BuiltCord],
    reading: CordReading,
    rng: np.random.Generator,
    unseen: UnseenStates,
    draws: int = 200,
    tolerances: Tolerances | None = None,
) -> list[SampledDevice]:
    """Draw built devices.

    Args:
        problem: The problem.
        cords: The planar cords of the layout.
        reading: How cords are read.
        rng: Random generator.
        unseen: States to train and to test on.
        draws: Number of devices.
        tolerances: Tolerances; the usual ones by default.
    """
    tolerances = tolerances or Tolerances()
    return [sample_device(problem, cords, reading, rng, tolerances, unseen) for _ in range(draws)]


def measure_devices(
    devices: Sequence[SampledDevice],
    decoder: str,
    unseen: UnseenStates,
    memory: MemoryResidual | None = None,
) -> Float:
    """Return the RMSE (d,) mm of sampled devices on unseen states.

    Args:
        devices: The devices.
        decoder: Kind of their decoders, see `fit_decoder`.
        unseen: The states that the devices were sampled for.
        memory: What is left of the cords' memory; nothing by default.
    """
    decoders: list[AnyDecoder] = []
    errors = []
    rng = np.random.default_rng(_MEMORY_SEED)
    for device in devices:
        if memory is not None:
            device = device.add_memory(memory, rng)
        rmse, decoders = _test_device(device, decoder, unseen, decoders)
        errors.append(rmse)
    return np.array(errors)


def sample_device(
    problem: Problem,
    cords: Sequence[BuiltCord],
    reading: CordReading,
    rng: np.random.Generator,
    tolerances: Tolerances,
    unseen: UnseenStates,
) -> SampledDevice:
    """Draw a built device and its test session.

    Args:
        problem: The problem.
        cords: The cords as designed.
        reading: How cords are read.
        rng: Random generator.
        tolerances: Tolerances of the device.
        unseen: States to train and to test on.
    """
    mixing = _amplitude_mixing(unseen, len(problem.markers), rng, tolerances.amplitude)
    columns, sigma = [], []
    for designed in cords:
        cord, cord_reading = sample_built_cord(designed, reading, rng, tolerances)
        moved = cord.path + np.tensordot(mixing, problem.deform(cord.path) - cord.path, 1)
        columns.append(np.append(0.0, cord_reading.signals(cord, moved)))
        sigma.append(cord_reading.noise(cord))
    signals, noise = np.stack(columns, axis=1), np.array(sigma)
    rest = problem.markers[:1]
    scaled = np.concatenate([rest, rest + np.tensordot(mixing, problem.markers[1:] - rest, 1)])
    outputs = reduce_outputs(scaled, problem.marker_weights)
    if unseen.shares is None:
        states = unseen.tested[np.sort(rng.integers(len(unseen.tested), size=tolerances.frames))]
    else:
        states = np.sort(rng.choice(len(signals), tolerances.frames, p=unseen.shares))
    readings = signals[states] + noise * rng.normal(0, 1, (tolerances.frames, len(cords)))
    return SampledDevice(signals, outputs, noise, states, readings)


def _test_device(
    device: SampledDevice, kind: str, unseen: UnseenStates, like: Sequence[AnyDecoder]
) -> tuple[float, list[AnyDecoder]]:
    """Return the RMSE (mm) of a device, and its decoders, one for each fold.

    States that no fold tests are tested by the decoder of the first.
    Decoders of a similar device (`like`) are the start, see `fit_decoder`.
    """
    square, decoders = 0.0, []
    signals, outputs, states = device.signals, device.outputs, device.states
    for k, (train, test) in enumerate(unseen.folds):
        start, repeats = like[k] if like else None, None
        in_fold = np.isin(states, test)
        if unseen.shares is not None:
            rows = np.round(_SESSION_ROWS * unseen.shares[train]).astype(int)
            repeats = np.maximum(rows, 1)
            in_fold |= (k == 0) & ~np.isin(states, unseen.tested)
        decoders.append(
            fit_decoder(kind, signals[train], outputs[train], device.noise, start, repeats)
        )
        if not in_fold.any():
            continue
        predicted = decoders[-1](device.readings[in_fold])
        square += float(((predicted - outputs[states[in_fold]]) ** 2).sum())
    return float(np.sqrt(square / len(states))), decoders


def _amplitude_mixing(
    unseen: UnseenStates, count: int, rng: np.random.Generator, sigma: float
) -> Float:
    """Return the mixture (s, s) of the states without rest that a device shows in their place.

    Each loading path is followed a little less or more far, through parabolas between its states. A
    state that is alone on its path stays, because a share of a large rotation is not a state of the
    body.
    """
    out = np.eye(count - 1)
    for states, fractions in unseen.paths:
        factor = max(1 + rng.normal(0, sigma), 0.0)
        if len(states) < 2:
            continue
        all_fractions = np.append(0.0, fractions)
        for k, fraction in zip(states, factor * fractions, strict=True):
            nearest = np.argsort(np.abs(all_fractions - fraction), kind="stable")[:3]
            out[k - 1] = 0.0
            for i in nearest:
                others = nearest[nearest != i]
                weight = np.prod(
                    (fraction - all_fractions[others]) / (all_fractions[i] - all_fractions[others])
                )
                if i:
                    out[k - 1, states[i - 1] - 1] += weight
    return out


def sample_built_cord(
    cord: BuiltCord, reading: CordReading, rng: np.random.Generator, tolerances: Tolerances
) -> tuple[BuiltCord, CordReading]:
    """Draw a built cord for a designed one.

    Args:
        cord: The cord as designed.
        reading: How cords are read.
        rng: Random generator.
        tolerances: Tolerances of the device.

    Returns:
        The built cord and how it is read.
    """
    path = _off_axis(cord.path, rng, tolerances.offset)
    if tolerances.resistance:
        factor = 1 + rng.normal(0, tolerances.resistance)
        reading = reading.scale_resistance(max(factor, _MIN_RESISTANCE_FACTOR))
    factor = 1 + rng.normal(0, tolerances.gauge)
    extra_length = rng.normal(0, tolerances.ends)
    missing_slope = rng.uniform(0, tolerances.compression)
    if cord.prestretch is None:
        return replace(cord, path=path), reading.scale_gauge_factor(factor, 1 - missing_slope)
    loose = cord.length / (1 + cord.prestretch) + extra_length
    prestretch = max(cord.length / max(loose, _MIN_LOOSE_LENGTH_MM) - 1, 0.0)
    return replace(cord, path=path, prestretch=prestretch), reading.scale_gauge_factor(factor)


def _normal(path: Float) -> Float:
    """Return the unit normal (3,) of the plane of a path (p, 3), independently of rounding.

    For a straight path it is the perpendicular direction nearest to a coordinate axis.
    """
    _, size, axes = np.linalg.svd(path - path.mean(0), full_matrices=False)
    normal = axes[2]
    if size[1] < _STRAIGHT_RTOL * size[0]:
        across = np.eye(3)[int(np.round(np.abs(axes[0]), 6).argmin())]
        normal = across - (across @ axes[0]) * axes[0]
        normal /= np.linalg.norm(normal)
    return np.asarray(normal * np.sign(normal[np.round(np.abs(normal), 6).argmax()]))


def _off_axis(path: Float, rng: np.random.Generator, offset: float) -> Float:
    """Return the path (p, 3) of a cord that wanders in its groove by up to `offset` mm."""
    normal = _normal(path)
    across = np.cross(normal, np.gradient(path, axis=0))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    where = np.linspace(0, 1, len(path))
    shift = [
        np.interp(
            where, np.linspace(0, 1, _WANDER_KNOTS), rng.uniform(-offset, offset, _WANDER_KNOTS)
        )[:, None]
        for _ in range(2)
    ]
    return np.asarray(path + shift[0] * across + shift[1] * normal)
