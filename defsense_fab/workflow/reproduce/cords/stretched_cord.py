"""A piece of cord stretched twice by one pattern (DefSense, Fig. 10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....core.arrays import Float
from ....twin.electronics.rubber_cords import CORD_KINDS, RubberPieces, RubberState
from ..experiments.experiment import CordPlan

_OHM_PER_MM, _RATE = 14.5, 50.0  # Hz
_LEVELS, _WITHIN, _HOLD = (1 / 3, 2 / 3, 1.0), (8.0, 2.0), 4.0  # of the strain; s up or down; s


@dataclass(frozen=True)
class Stretched:
    """A piece stretched twice by one pattern: `time` (n,) s, `strain` (n,), and (R - R0)/R0 of both
    passes, `answers` (2, n)."""

    time: Float
    strain: Float
    answers: Float

    @property
    def hysteresis(self) -> float:
        """Half of what going out and coming back differ by at one strain, on average over strains
        and passes, relative to the greatest answer."""
        out = np.gradient(self.strain, self.time) > 1e-9
        back = np.gradient(self.strain, self.time) < -1e-9
        at = np.linspace(0.1, 0.9, 17) * self.strain.max()
        apart = [
            _mean_at(at, self.strain[back], a[back]) - _mean_at(at, self.strain[out], a[out])
            for a in self.answers
        ]
        return float(np.abs(apart).mean() / 2 / np.abs(self.answers).max())

    @property
    def repeatability(self) -> float:
        """Root mean square of what the passes differ by at one time of the pattern, relative to the
        greatest answer."""
        first, second = self.answers
        return float(np.sqrt(((second - first) ** 2).mean()) / np.abs(self.answers).max())


def stretched(plan: CordPlan, kind: str, seed: int) -> Stretched:
    """A piece of the `sample` length, new as it is sold, stretched twice by the plan's strain in
    steps, slowly and quickly."""
    traits = CORD_KINDS[kind].traits
    rng = np.random.default_rng([seed, 10])
    time, strain = _pattern(plan.strain)
    both = np.concatenate([time, time[-1] + 1 / _RATE + time])
    ideal = plan.k_res * np.concatenate([strain, strain])[:, None]
    pieces = RubberPieces.drawn(traits, np.array([_OHM_PER_MM * plan.sample]), rng)
    ohm, _ = pieces.resistances(both, ideal, RubberState.new(traits, 1), rng)
    answers = (ohm[:, 0] / ohm[0, 0] - 1).reshape(2, -1)
    return Stretched(time, strain, answers)


def _pattern(most: float) -> tuple[Float, Float]:
    """Strain over time: to each level and back, slowly and quickly, with a pause at both ends."""
    times, strains = [0.0], [0.0]
    for within in _WITHIN:
        for level in _LEVELS:
            for target in (level * most, 0.0):
                times += [times[-1] + within, times[-1] + within + _HOLD]
                strains += [target, target]
    time = np.arange(0, times[-1], 1 / _RATE)
    return time, np.interp(time, times, strains)


def _mean_at(at: Float, strain: Float, answer: Float) -> Float:
    """Mean answer (k,) near the strains `at` (k,)."""
    near = np.abs(strain - at[:, None]) < 0.5 * (at[1] - at[0])
    return np.asarray((near * answer).sum(1) / np.maximum(near.sum(1), 1))
