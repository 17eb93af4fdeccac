"""What the optimiser works on: the simulated states, the outputs, the cord and the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..core.mesh import Surface
from ..mechanics.locate import PointLocator
from ..sensing import decoder
from ..sensing.signal import signals


@dataclass(frozen=True)
class Limits:
    """Least wall, radius of curvature and centre distance of cords; channel diameter; all mm."""

    wall: float
    min_radius: float
    clearance: float
    channel_diameter: float
    #: Smallest part as a fraction of the body: cord planes that nearly meet leave slivers.
    smallest_part: float = 0.01

    @property
    def depth(self) -> float:
        """Least distance of a cord's centre line from the surface."""
        return self.wall + self.channel_diameter / 2


@dataclass(frozen=True)
class Problem:
    """States `fields` (s, n, 3) mm without rest; `markers` (s + 1, k, 3) mm displacements, rest
    first; `marker_weights` (k,) summing to one; `gauge_factor`, `noise` of (R - R0)/R0."""

    surface: Surface
    locator: PointLocator
    fields: Float
    markers: Float
    marker_weights: Float
    gauge_factor: float
    noise: float
    limits: Limits

    @property
    def ridge(self) -> float:
        return decoder.ridge_weight(len(self.markers), self.noise)

    def outputs(self) -> Float:
        """Centred outputs (s + 1, r), reduced by SVD to at most s + 1 columns."""
        scaled = self.markers * np.sqrt(self.marker_weights)[:, None]
        flat = scaled.reshape(len(scaled), -1)
        u, s, _ = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
        return np.asarray(u * s)

    def deform(self, points: Float) -> Float:
        """Deformed positions (s, ..., 3) of rest points (..., 3)."""
        flat = points.reshape(-1, 3)
        at = self.locator.find(flat)
        u = self.locator.displacement(at, self.fields)
        return np.asarray((flat + u).reshape(len(self.fields), *points.shape))

    def signals(self, points: Float) -> Float:
        """Signals (s + 1, ...) of polylines (..., p, 3), the zero of rest first."""
        moved = signals(points, self.deform(points), self.gauge_factor)
        return np.concatenate([np.zeros((1, *moved.shape[1:])), moved])

    def floor(self, sensors: int) -> float:
        return decoder.floor(self.outputs(), sensors)


def expected_error(signal: Float, outputs: Float, ridge: float) -> float:
    """Expected RMSE (mm) of the best affine map under noise, from signals (n, c)."""
    s = signal - signal.mean(0)
    beta = np.linalg.solve(s.T @ s + ridge * np.eye(s.shape[1]), s.T @ outputs)
    square = ((s @ beta - outputs) ** 2).sum() + ridge * (beta**2).sum()
    return float(np.sqrt(square / len(outputs)))
