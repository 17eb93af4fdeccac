"""How far built devices will scatter about a prediction: Monte Carlo over what a maker cannot hold.

Each draw is one device: its cords lie off their grooves' axes, differ in their gauge factors, and
its poses are not taken to the full amplitude; its decoder is the best for its own signals and their
noise, which long training comes to, and is tested on a session of noisy frames of other states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device import Sensor
from ...core.path_sampling import sample_path
from ...decoding.decoders import Trained, fit_decoder
from ...decoding.unseen import UnseenStates
from ...sensing.signal import signals
from ..problem.problem import Problem, reduce_outputs

#: A cord wanders in its groove between so many points along its path.
_KNOTS = 5


@dataclass(frozen=True)
class Tolerances:
    """`offset` mm is the largest distance of a cord from its groove's axis, either way in the plane
    and across it; `gauge` and `amplitude` are relative standard deviations, of the cords' gauge
    factors and of the poses' amplitudes; `frames` is the length of the test."""

    offset: float = 0.3
    gauge: float = 0.05
    amplitude: float = 0.05
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
    sensors: Sequence[Sensor],
    rng: np.random.Generator,
    unseen: UnseenStates,
    draws: int = 200,
    tolerances: Tolerances | None = None,
) -> ToleranceBand:
    """The band that devices with these cords are expected in, on the states of the problem that are
    `unseen`."""
    like: list[Trained] = []
    found = []
    for _ in range(draws):
        rmse, like = session(problem, sensors, rng, tolerances or Tolerances(), unseen, like)
        found.append(rmse)
    low, median, high = np.quantile(found, [0.05, 0.5, 0.95])
    return ToleranceBand(float(median), float(low), float(high))


def session(
    problem: Problem,
    sensors: Sequence[Sensor],
    rng: np.random.Generator,
    tolerances: Tolerances,
    unseen: UnseenStates,
    like: Sequence[Trained] = (),
) -> tuple[float, list[Trained]]:
    """RMSE (mm) of one device on its test frames, which show the states tested at random, and its
    decoders, one for each fold; see `fit_decoder` for those of another device, `like`."""
    mixing = _taken_less_far(unseen, len(problem.markers), rng, tolerances.amplitude)
    columns = []
    for sensor in sensors:
        path = _off_axis(sensor, rng, tolerances.offset)
        moved = path + np.tensordot(mixing, problem.deform(path) - path, 1)
        gauge = 1 + rng.normal(0, tolerances.gauge)
        columns.append(np.concatenate([[0.0], gauge * signals(path, moved, problem.response)]))
    S = np.stack(columns, axis=1)
    rest = problem.markers[:1]
    scaled = np.concatenate([rest, rest + np.tensordot(mixing, problem.markers[1:] - rest, 1)])
    O = reduce_outputs(scaled, problem.marker_weights)  # noqa: E741
    which = np.sort(rng.integers(len(unseen.tested), size=tolerances.frames))
    shown = unseen.tested[which]
    read = S[shown] + rng.normal(0, problem.noise, (tolerances.frames, len(sensors)))
    square, decoders = 0.0, []
    for k, (seen, test) in enumerate(unseen.folds):
        begun = like[k] if like else None
        decoders.append(fit_decoder(problem.decoder, S[seen], O[seen], problem.noise, begun))
        mine = np.isin(shown, test)
        square += float(((decoders[-1](read[mine]) - O[shown[mine]]) ** 2).sum())
    return float(np.sqrt(square / tolerances.frames)), decoders


def _taken_less_far(
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


def _off_axis(sensor: Sensor, rng: np.random.Generator, offset: float) -> Float:
    """The path (p, 3) of a cord that wanders in its groove, by up to `offset` either way."""
    path = sample_path(sensor)
    across = np.cross(sensor.plane.normal, np.gradient(path, axis=0))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    where = np.linspace(0, 1, len(path))
    shift = [
        np.interp(where, np.linspace(0, 1, _KNOTS), rng.uniform(-offset, offset, _KNOTS))[:, None]
        for _ in range(2)
    ]
    return np.asarray(path + shift[0] * across + shift[1] * sensor.plane.normal)
