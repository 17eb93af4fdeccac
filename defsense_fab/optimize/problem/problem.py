"""What the optimiser works on: the simulated states, the outputs, the cord and the limits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...core.arrays import Float
from ...core.errors import LayoutError
from ...core.mesh import Surface
from ...decoding.elimination import expected_square
from ...decoding.expected_errors import floor
from ...decoding.ridge import KINDS, Features
from ...geometry.kernels.surface_queries import SignedDistance, signed_distance_of
from ...mechanics.elements.point_location import PointLocator
from .cord_signals import CordCarrier, SignalModel
from .depth_grid import DepthGrid

# Random points inside the body, evenly or where its strain varies most between the states.


def sample_interior(problem: Problem, count: int, rng: np.random.Generator) -> Float:
    """Points (count, 3) mm spread evenly over the tets' volume."""
    corners = problem.locator.mesh.nodes[problem.locator.mesh.cells[:, :4]]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    tet = rng.choice(len(volume), count, p=volume / volume.sum())
    weights = rng.dirichlet(np.ones(4), count)
    return np.asarray(np.einsum("ci,cij->cj", weights, corners[tet]))


def sample_by_strain(
    problem: Problem, points: Float, count: int, rng: np.random.Generator
) -> Float:
    """`count` of the points (p, 3), with repeats, the more of them the more the Green strain there
    varies between the states: the paper's advice for where cords should run."""
    varies = np.sqrt(green_strains(problem, points).var(axis=0).sum((1, 2)))
    if varies.sum() <= 0:
        varies = np.ones(len(points))
    return np.asarray(points[rng.choice(len(points), count, p=varies / varies.sum())])


def green_strains(problem: Problem, points: Float) -> Float:
    """Green strain (n, p, 3, 3) at points (p, 3) mm in all states, rest first."""
    found = problem.locator.find(points)
    F = np.eye(3) + problem.locator.gradient(found, problem.fields)
    E = (F.swapaxes(-1, -2) @ F - np.eye(3)) / 2
    return np.concatenate([np.zeros((1, *E.shape[1:])), E])


_MIN_MARKER_MOTION_MM = 1e-6  # mm


@dataclass(frozen=True)
class Limits:
    """Least wall, radius of curvature and centre distance of cords; channel diameter; least and
    greatest length of a channel from surface to surface; length and diameter of the pockets at its
    ends, 0 without; all mm."""

    wall: float
    min_radius: float
    clearance: float
    channel_diameter: float
    #: Smallest part as a fraction of the body: cord planes that nearly meet leave slivers.
    smallest_part: float = 0.01
    shortest: float = 0.0
    longest: float = np.inf
    pocket: tuple[float, float] = (0.0, 0.0)

    @property
    def lengths(self) -> str:
        """The lengths of channels that are allowed, in words."""
        if np.isinf(self.longest):
            return f"{self.shortest:.1f} mm are asked for at least"
        return f"{self.shortest:.1f} to {self.longest:.1f} mm are allowed"

    @property
    def depth(self) -> float:
        """Least distance of a cord's centre line from the surface."""
        return self.wall + self.channel_diameter / 2


@dataclass(frozen=True)
class Problem:
    """States `fields` (s, n, 3) mm without rest; `markers` (s + 1, k, 3) mm displacements, rest
    first; `marker_weights` (k,) summing to one; how cords `sense`, and their `noise`, the standard
    deviation of (R - R0)/R0 of a long one.

    Raises LayoutError for values that are not finite, and for states that move no marker.
    """

    surface: Surface
    locator: PointLocator
    fields: Float
    markers: Float
    marker_weights: Float
    sense: SignalModel
    noise: float
    limits: Limits
    decoder: str = "affine"

    def __post_init__(self) -> None:
        for what, values in (("field", self.fields), ("markers' displacement", self.markers)):
            broken = np.flatnonzero(~np.isfinite(values).all(axis=(1, 2)))
            if len(broken):
                state = int(broken[0]) + (what == "field")
                raise LayoutError(
                    f"the {what} of state {state} (rest is 0) has values that are not finite",
                    code="not-finite",
                    action="Simulate the poses again",
                    quantity=what,
                    state=state,
                )
        if np.abs(self.markers - self.markers[:1]).max(initial=0) < _MIN_MARKER_MOTION_MM:
            raise LayoutError(
                "all states leave the markers where they are: there is nothing to sense",
                code="nothing-to-sense",
                action="Give [[poses]] that move the body, or other [outputs] markers",
            )

    def with_decoder(self, kind: str) -> Problem:
        """The same for another decoder; what was made once is shared."""
        out = replace(self, decoder=kind)
        made = {"carrier", "depth", "grid", "outputs"} & vars(self).keys()
        vars(out).update({k: vars(self)[k] for k in made})
        return out

    def features(self, cords: int) -> Features:
        """What the decoder that will be used sees of the signals."""
        return KINDS[self.decoder](cords)

    @cached_property
    def carrier(self) -> CordCarrier:
        """What moves cords with the fields; made once, its tables are large."""
        return CordCarrier(self.locator, self.fields, self.sense)

    @cached_property
    def depth(self) -> SignedDistance:
        """Exact depth below the surface."""
        return signed_distance_of(self.surface)

    @cached_property
    def grid(self) -> DepthGrid:
        """Depth on a grid, for very many points."""
        return DepthGrid(self.surface)

    @cached_property
    def outputs(self) -> Float:
        """Centred outputs (s + 1, r), reduced by SVD to at most s + 1 columns."""
        return reduce_outputs(self.markers, self.marker_weights)

    def deform(self, points: Float) -> Float:
        """Deformed positions (s, ..., 3) of rest points (..., 3)."""
        moved = self.carrier.move(points.reshape(-1, 3))
        return moved.reshape(len(self.fields), *points.shape)

    def signals(self, points: Float) -> Float:
        """Signals (s + 1, ...) of polylines (..., p, 3), the zero of rest first, all with the same
        `noise`: see `SignalModel`."""
        shape = points.shape[:-2]
        moved = self.carrier.signals(points.reshape(-1, *points.shape[-2:]))
        return np.concatenate([np.zeros((1, *shape)), moved.reshape(len(self.fields), *shape)])

    def floor(self, sensors: int) -> float:
        return floor(self.outputs, sensors)

    def expected_error(self, signals: Float) -> Float:
        """Expected RMSE (mm) of the best decoder under noise, for each set of signals
        (..., n, c)."""
        features = self.features(signals.shape[-1])
        square = expected_square(features, signals, self.outputs, self.noise)
        return np.asarray(np.sqrt(np.maximum(square, 0) / len(self.markers)))


def reduce_outputs(markers: Float, weights: Float) -> Float:
    """Centred outputs (n, r), r at most n, of marker displacements (n, k, 3) mm with weights (k,):
    the squared norm of a row is the state's mean squared distance from the mean."""
    flat = (markers * np.sqrt(weights)[:, None]).reshape(len(markers), -1)
    u, s, _ = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
    return np.asarray(u * s)
