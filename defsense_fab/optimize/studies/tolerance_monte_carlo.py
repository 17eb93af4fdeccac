"""How far built devices will scatter about a prediction: Monte Carlo over what a maker cannot hold.

Each draw is one device: its cords lie off their grooves' axes, differ in their gauge factors, and
its poses are not taken to the full amplitude; its decoder is the best for its own signals and their
noise, which long training comes to, and is tested on a session of noisy frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device import Sensor
from ...core.path_sampling import sample_path
from ...decoding.decoders import Trained, fit_decoder
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
    """RMSE (mm) of built devices: median, and the limits between which 90 % of them lie."""

    median: float
    low: float
    high: float


def tolerance_band(
    problem: Problem,
    sensors: Sequence[Sensor],
    rng: np.random.Generator,
    draws: int = 200,
    tolerances: Tolerances | None = None,
) -> ToleranceBand:
    """The band that devices with these cords are expected in."""
    like: Trained | None = None
    found = []
    for _ in range(draws):
        rmse, like = session(problem, sensors, rng, tolerances or Tolerances(), like)
        found.append(rmse)
    low, median, high = np.quantile(found, [0.05, 0.5, 0.95])
    return ToleranceBand(float(median), float(low), float(high))


def session(
    problem: Problem,
    sensors: Sequence[Sensor],
    rng: np.random.Generator,
    tolerances: Tolerances,
    like: Trained | None = None,
) -> tuple[float, Trained]:
    """RMSE (mm) of one device on its test frames, which show its states at random, and its
    decoder; see `train` for `like`."""
    amplitude = np.maximum(1 + rng.normal(0, tolerances.amplitude, len(problem.fields)), 0)
    columns = []
    for sensor in sensors:
        path = _off_axis(sensor, rng, tolerances.offset)
        moved = path + amplitude[:, None, None] * (problem.deform(path) - path)
        gauge = 1 + rng.normal(0, tolerances.gauge)
        columns.append(np.concatenate([[0.0], gauge * signals(path, moved, problem.response)]))
    S = np.stack(columns, axis=1)
    scaled = problem.markers * np.concatenate([[1.0], amplitude])[:, None, None]
    O = reduce_outputs(scaled, problem.marker_weights)  # noqa: E741
    decoder = fit_decoder(problem.decoder, S, O, problem.noise, like)
    shown = rng.integers(len(S), size=tolerances.frames)
    read = S[shown] + rng.normal(0, problem.noise, (tolerances.frames, len(sensors)))
    return float(np.sqrt(((decoder(read) - O[shown]) ** 2).sum(1).mean())), decoder


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
