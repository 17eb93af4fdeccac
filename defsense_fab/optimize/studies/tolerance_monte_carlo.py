"""How far built devices will scatter about a prediction: Monte Carlo over what a maker cannot hold.

Each draw is one device: its cords lie off their grooves' axes, differ in their response, are
stretched more or less as they are laid, and its poses are not taken to the full amplitude; its
decoder is the best for its own signals and their noise, which long training comes to, and is tested
on a session of noisy frames of other states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...decoding.decoders import Trained, fit_decoder
from ...decoding.expected_errors import UnseenStates
from ...sensing.built_cord import PRESTRETCH_SPREAD, BuiltCord, CordReading
from ..problem.problem import Problem, reduce_outputs

#: A cord wanders in its groove between so many points along its path.
_WANDER_KNOTS = 5
#: Of its length: a path that leaves its line by less has no plane.
_STRAIGHT_RTOL = 1e-6


@dataclass(frozen=True)
class Tolerances:
    """`offset` mm is the largest distance of a cord from its groove's axis, either way in the plane
    and across it; `gauge` and `amplitude` are relative standard deviations, of the cords' gauge
    factors and of the poses' amplitudes; `prestretch` that of a held cord's pre-stretch, a strain;
    `compression` the share of its slope that a response may lack below zero strain, at most;
    `frames` is the length of the test."""

    offset: float = 0.3
    gauge: float = 0.05
    amplitude: float = 0.05
    prestretch: float = PRESTRETCH_SPREAD
    compression: float = 0.5
    frames: int = 600


@dataclass(frozen=True)
class ToleranceBand:
    """RMSE (mm) of built devices on the states tested: median, and the limits between which 90 % of
    them lie."""

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
    """The band that devices with these planar cords are expected in, on the states of the problem
    that are `unseen`."""
    like: list[Trained] = []
    found = []
    for _ in range(draws):
        some = tolerances or Tolerances()
        rmse, like = simulate_session(problem, cords, reading, rng, some, unseen, like)
        found.append(rmse)
    low, median, high = np.quantile(found, [0.05, 0.5, 0.95])
    return ToleranceBand(float(median), float(low), float(high))


def simulate_session(
    problem: Problem,
    cords: Sequence[BuiltCord],
    reading: CordReading,
    rng: np.random.Generator,
    tolerances: Tolerances,
    unseen: UnseenStates,
    like: Sequence[Trained] = (),
) -> tuple[float, list[Trained]]:
    """RMSE (mm) of one device on its test frames, which show the states tested at random, and its
    decoders, one for each fold; see `fit_decoder` for those of another device, `like`."""
    mixing = _amplitude_mixing(unseen, len(problem.markers), rng, tolerances.amplitude)
    columns, sigma = [], []
    for designed in cords:
        cord, own = sample_built_cord(designed, reading, rng, tolerances)
        moved = cord.path + np.tensordot(mixing, problem.deform(cord.path) - cord.path, 1)
        columns.append(np.append(0.0, own.signals(cord, moved)))
        sigma.append(own.noise(cord))
    S, noise = np.stack(columns, axis=1), np.array(sigma)
    rest = problem.markers[:1]
    scaled = np.concatenate([rest, rest + np.tensordot(mixing, problem.markers[1:] - rest, 1)])
    O = reduce_outputs(scaled, problem.marker_weights)  # noqa: E741
    which = np.sort(rng.integers(len(unseen.tested), size=tolerances.frames))
    shown = unseen.tested[which]
    read = S[shown] + noise * rng.normal(0, 1, (tolerances.frames, len(cords)))
    square, decoders = 0.0, []
    for k, (seen, test) in enumerate(unseen.folds):
        begun = like[k] if like else None
        decoders.append(fit_decoder(problem.decoder, S[seen], O[seen], noise, begun))
        mine = np.isin(shown, test)
        square += float(((decoders[-1](read[mine]) - O[shown[mine]]) ** 2).sum())
    return float(np.sqrt(square / tolerances.frames)), decoders


def _amplitude_mixing(
    unseen: UnseenStates, count: int, rng: np.random.Generator, sigma: float
) -> Float:
    """Weights (s, s) of the s = count - 1 states without rest in what a device shows instead: each
    path of loading is taken a little less or more far, through parabolas between its states. A
    state that is alone on its path stays: a share of a large rotation is no state of the body."""
    out = np.eye(count - 1)
    for states, fractions in unseen.paths:
        factor = max(1 + rng.normal(0, sigma), 0.0)
        if len(states) < 2:
            continue
        known = np.append(0.0, fractions)
        for k, at in zip(states, factor * fractions, strict=True):
            near = np.argsort(np.abs(known - at), kind="stable")[:3]
            out[k - 1] = 0.0
            for i in near:
                others = near[near != i]
                weight = np.prod((at - known[others]) / (known[i] - known[others]))
                if i:
                    out[k - 1, states[i - 1] - 1] += weight
    return out


def sample_built_cord(
    cord: BuiltCord, reading: CordReading, rng: np.random.Generator, tolerances: Tolerances
) -> tuple[BuiltCord, CordReading]:
    """One of the cords that a maker may get for this one, and how it is read."""
    path = _off_axis(cord.path, rng, tolerances.offset)
    factor = 1 + rng.normal(0, tolerances.gauge)
    more = rng.normal(0, tolerances.prestretch)
    lacking = rng.uniform(0, tolerances.compression)
    if cord.prestretch is None:
        return replace(cord, path=path), reading.gauge_spread(factor, 1 - lacking)
    laid = max(cord.prestretch + more, 0.0)
    return replace(cord, path=path, prestretch=laid), reading.gauge_spread(factor)


def _normal(path: Float) -> Float:
    """Unit normal (3,) of the plane of a path (p, 3), or where it is straight that across it which
    is nearest to an axis; the same whatever rounding does."""
    _, size, axes = np.linalg.svd(path - path.mean(0), full_matrices=False)
    normal = axes[2]
    if size[1] < _STRAIGHT_RTOL * size[0]:
        across = np.eye(3)[int(np.round(np.abs(axes[0]), 6).argmin())]
        normal = across - (across @ axes[0]) * axes[0]
        normal /= np.linalg.norm(normal)
    return np.asarray(normal * np.sign(normal[np.round(np.abs(normal), 6).argmax()]))


def _off_axis(path: Float, rng: np.random.Generator, offset: float) -> Float:
    """The path (p, 3) of a cord that wanders in its groove, by up to `offset` either way."""
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
