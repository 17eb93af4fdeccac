"""Predict how the errors of built devices scatter, by Monte Carlo over manufacturing tolerances.

Each draw is one device. Its cords lie off the axes of their grooves, differ in their response and
are stretched more or less during assembly, and its poses do not reach the full amplitude. Its
decoder is the best for its signals and their noise, which long training converges to, and is tested
on a session of noisy frames of other states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...decoding.decoders import AnyDecoder, fit_decoder
from ...decoding.expected_errors import UnseenStates
from ...sensing.built_cord import PRESTRETCH_SPREAD, BuiltCord, CordReading
from ..problem.problem import Problem, reduce_outputs

_WANDER_KNOTS = 5  # points along a path between which a cord wanders in its groove
_STRAIGHT_RTOL = 1e-6  # of its length, by which a straight path may leave its line


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of built devices.

    Attributes:
        offset: Largest distance of a cord from its groove's axis, in the plane and across it, mm.
        gauge: Relative standard deviation of the cords' gauge factors.
        amplitude: Relative standard deviation of the poses' amplitudes.
        prestretch: Standard deviation of a held cord's pre-stretch, a strain.
        compression: Largest share of its slope that a response may lack below zero strain.
        frames: Number of frames of the test.
    """

    offset: float = 0.3
    gauge: float = 0.05
    amplitude: float = 0.05
    prestretch: float = PRESTRETCH_SPREAD
    compression: float = 0.5
    frames: int = 600


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


def tolerance_band(
    problem: Problem,
    cords: Sequence[BuiltCord],
    reading: CordReading,
    rng: np.random.Generator,
    unseen: UnseenStates,
    draws: int = 200,
    tolerances: Tolerances | None = None,
) -> ToleranceBand:
    """Predict the band of errors of built devices on unseen states.

    Args:
        problem: The problem.
        cords: The planar cords of the layout.
        reading: How cords are read.
        rng: Random generator.
        unseen: States to train and to test on.
        draws: Number of devices.
        tolerances: Tolerances; the usual ones by default.
    """
    decoders: list[AnyDecoder] = []
    errors = []
    for _ in range(draws):
        used_tolerances = tolerances or Tolerances()
        rmse, decoders = simulate_session(
            problem, cords, reading, rng, used_tolerances, unseen, decoders
        )
        errors.append(rmse)
    low, median, high = np.quantile(errors, [0.05, 0.5, 0.95])
    return ToleranceBand(float(median), float(low), float(high))


def simulate_session(
    problem: Problem,
    cords: Sequence[BuiltCord],
    reading: CordReading,
    rng: np.random.Generator,
    tolerances: Tolerances,
    unseen: UnseenStates,
    like: Sequence[AnyDecoder] = (),
) -> tuple[float, list[AnyDecoder]]:
    """Simulate a test session of one device, whose frames show the tested states at random.

    Args:
        problem: The problem.
        cords: The cords as designed.
        reading: How cords are read.
        rng: Random generator.
        tolerances: Tolerances of the device.
        unseen: States to train and to test on.
        like: Decoders of a similar device to start from, see `fit_decoder`.

    Returns:
        RMSE (mm) and the device's decoders, one for each fold.
    """
    mixing = _amplitude_mixing(unseen, len(problem.markers), rng, tolerances.amplitude)
    columns, sigma = [], []
    for designed in cords:
        cord, cord_reading = sample_built_cord(designed, reading, rng, tolerances)
        moved = cord.path + np.tensordot(mixing, problem.deform(cord.path) - cord.path, 1)
        columns.append(np.append(0.0, cord_reading.signals(cord, moved)))
        sigma.append(cord_reading.noise(cord))
    S, noise = np.stack(columns, axis=1), np.array(sigma)
    rest = problem.markers[:1]
    scaled = np.concatenate([rest, rest + np.tensordot(mixing, problem.markers[1:] - rest, 1)])
    O = reduce_outputs(scaled, problem.marker_weights)  # noqa: E741
    picks = np.sort(rng.integers(len(unseen.tested), size=tolerances.frames))
    states = unseen.tested[picks]
    read = S[states] + noise * rng.normal(0, 1, (tolerances.frames, len(cords)))
    square, decoders = 0.0, []
    for k, (train, test) in enumerate(unseen.folds):
        start = like[k] if like else None
        decoders.append(fit_decoder(problem.decoder, S[train], O[train], noise, start))
        in_fold = np.isin(states, test)
        square += float(((decoders[-1](read[in_fold]) - O[states[in_fold]]) ** 2).sum())
    return float(np.sqrt(square / tolerances.frames)), decoders


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
    factor = 1 + rng.normal(0, tolerances.gauge)
    extra_prestretch = rng.normal(0, tolerances.prestretch)
    missing_slope = rng.uniform(0, tolerances.compression)
    if cord.prestretch is None:
        return replace(cord, path=path), reading.scale_gauge_factor(factor, 1 - missing_slope)
    prestretch = max(cord.prestretch + extra_prestretch, 0.0)
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
