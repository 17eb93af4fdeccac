"""A synthetic device: smooth movements, nonlinear signals that relax, nonlinear markers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from defsense_fab.core.arrays import Float
from defsense_fab.training.data.dataset import Dataset, Recording

CHANNELS = ("left", "top", "right")
Maker = Callable[..., Dataset]


def walk(time: Float, count: int, rng: np.random.Generator, every: float = 2.0) -> Float:
    """Return smooth random levels (t, count) between -1 and 1, with a knot `every` s."""
    knots = np.arange(int(time[-1] / every) + 3) * every
    return np.tanh(CubicSpline(knots, rng.uniform(-1, 1, (len(knots), count)))(time))


def relaxed(time: Float, signals: Float, share: float, constant: float) -> Float:
    """Add a signal that grows with any movement and decays.

    Unlike the decoder's memories, this is not a linear filter of the signal.
    """
    added, out = np.zeros(signals.shape[1]), np.empty_like(signals)
    steps = np.abs(np.diff(signals, axis=0, prepend=signals[:1]))
    for k, dt in enumerate(np.diff(time, prepend=time[0])):
        added = added * np.exp(-dt / constant) + share * steps[k]
        out[k] = added
    return signals + out


@pytest.fixture(scope="session")
def recorded() -> Maker:
    """Return a function that makes datasets of the same device."""

    def make(
        seconds: float = 60.0,
        seed: int = 0,
        *,
        noise: float = 5e-4,
        tear: float = 0.0,
        sigma: float = 0.05,
        gaps: float = 0.0,
        rate: float = 30.0,
        markers: int = 6,
        gain: float | list[float] = 1.0,
        name: str = "run-1",
    ) -> Dataset:
        body, rng = np.random.default_rng(7), np.random.default_rng(seed)
        c = len(CHANNELS)
        bend, more = 0.06 * np.eye(c) + 0.02 * body.normal(size=(c, c)), body.normal(size=(6, c))
        moves, curls = 8 * body.normal(size=(c, markers, 3)), body.normal(size=(6, markers, 3))
        rest_points = body.uniform(-40, 40, (markers, 3))
        when = np.arange(0.0, seconds, 1 / 60)
        i, j = np.triu_indices(c)

        levels = walk(when, c, rng)
        pairs = levels[:, i] * levels[:, j]
        ideal = levels @ bend + 0.005 * pairs @ more
        torn = relaxed(when, ideal, tear, 3.0) if tear else ideal
        ohm = 1500 * (1 + gain * torn + noise * rng.normal(size=ideal.shape))

        time = np.arange(0.02, seconds - 0.02, 1 / rate)
        now = np.stack([np.interp(time, when, x) for x in levels.T], axis=1)
        points = rest_points + np.tensordot(now, moves, 1)
        points = points + np.tensordot(now[:, i] * now[:, j], curls, 1)
        points += sigma * rng.normal(size=points.shape)
        points[rng.random(points.shape[:2]) < gaps] = np.nan
        spread = np.where(np.isfinite(points), sigma, np.nan)
        rest = np.full(c, 1500.0)
        run = Recording(name, "session", "1", when, ohm, rest, time, points, spread)
        return Dataset("toy", "hash", CHANNELS, np.arange(markers), rest_points, (run,))

    return make
