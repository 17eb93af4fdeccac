"""Define the optimization problem: simulated states, outputs, the cord and the limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.regions import Shape, inset
from ...core.errors import LayoutError
from ...core.mesh import Surface
from ...decoding.elimination import expected_square
from ...decoding.expected_errors import affine_error_floor
from ...decoding.ridge import FEATURES, Features
from ...geometry.bodies.regions import EXIT_TOLERANCE_MM
from ...geometry.kernels.surface_queries import SignedDistance, signed_distance_of
from ...mechanics.elements.point_location import PointLocator
from .cord_signals import CordCarrier, SignalModel
from .depth_grid import DepthGrid


def sample_interior(problem: Problem, count: int, rng: np.random.Generator) -> Float:
    """Draw random points (count, 3) mm spread evenly over the body's volume."""
    corners = problem.locator.mesh.nodes[problem.locator.mesh.cells[:, :4]]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    tet = rng.choice(len(volume), count, p=volume / volume.sum())
    weights = rng.dirichlet(np.ones(4), count)
    return np.asarray(np.einsum("ci,cij->cj", weights, corners[tet]))


def sample_by_strain(
    problem: Problem, points: Float, count: int, rng: np.random.Generator
) -> Float:
    """Draw points, with repeats, in proportion to how much the strain there varies between states.

    The paper (DefSense, CHI 2016) advises cords to run there.

    Args:
        problem: The problem.
        points: Points (p, 3) mm to draw from.
        count: Number of points to draw.
        rng: Random generator.
    """
    varies = np.sqrt(green_strains(problem, points).var(axis=0).sum((1, 2)))
    if varies.sum() <= 0:
        varies = np.ones(len(points))
    return np.asarray(points[rng.choice(len(points), count, p=varies / varies.sum())])


def green_strains(problem: Problem, points: Float) -> Float:
    """Return the Green strain (n, p, 3, 3) at points (p, 3) mm in all states, rest first."""
    places = problem.locator.find(points)
    F = np.eye(3) + problem.locator.gradient(places, problem.fields)
    E = (F.swapaxes(-1, -2) @ F - np.eye(3)) / 2
    return np.concatenate([np.zeros((1, *E.shape[1:])), E])


_MIN_MARKER_MOTION_MM = 1e-6  # below, markers count as unmoved


@dataclass(frozen=True)
class Limits:
    """What every layout must keep, all in mm.

    Attributes:
        wall: Smallest wall between a channel and the surface.
        min_radius: Smallest radius of curvature.
        clearance: Smallest distance of the center lines of two cords.
        channel_diameter: Diameter of the channels.
        smallest_part: Smallest part as a fraction of the body; planes that nearly meet leave
            slivers.
        shortest: Smallest length of a channel from surface to surface.
        longest: Largest length of a channel.
        pocket: Length and diameter of the pockets at a channel's ends, zero without pockets.
        is_cut: Whether the body is cut along the planes; it is not around printed traces.
        exits: Regions in which both ends of every cord leave the body; empty for anywhere.
        kept_whole: Bounded regions that no channel and no cut may cross.
        pad: Diameter and depth below the skin of the pads at the ends of printed traces, zero
            without pads.
    """

    wall: float
    min_radius: float
    clearance: float
    channel_diameter: float
    smallest_part: float = 0.01
    shortest: float = 0.0
    longest: float = np.inf
    pocket: tuple[float, float] = (0.0, 0.0)
    is_cut: bool = True
    exits: tuple[Shape, ...] = ()
    kept_whole: tuple[Shape, ...] = ()
    pad: tuple[float, float] = (0.0, 0.0)

    @property
    def noun(self) -> str:
        """What texts call a path: "cord" or "trace"."""
        return "cord" if self.is_cut else "trace"

    @property
    def pad_reach(self) -> float:
        """Largest distance of a pad's filament from its middle on the skin."""
        return math.hypot(self.pad[0] / 2, self.pad[1])

    @property
    def pad_to_pad(self) -> float:
        """Smallest distance of the axes of two pads."""
        return self.pad[0] + self.wall

    @property
    def pad_to_path(self) -> float:
        """Smallest distance of a pad's axis from the center line of another strand."""
        return (self.pad[0] + self.channel_diameter) / 2 + self.wall

    @property
    def lengths(self) -> str:
        """The allowed lengths of channels, for people."""
        if np.isinf(self.longest):
            return f"at least {self.shortest:.1f} mm are required"
        return f"{self.shortest:.1f} to {self.longest:.1f} mm are allowed"

    def exit_room(self, mouths: Float) -> tuple[Float, Float]:
        """Return how far inside a region of `exits`, at least one, points are.

        Regions count as slightly larger, so that one may end at the skin.

        Args:
            mouths: Points (n, 3), mm.

        Returns:
            Distances (n,) mm, negative outside of all, and gradients (n, 3).
        """
        rooms, gradients = zip(*(inset(shape, mouths) for shape in self.exits), strict=True)
        best, row = np.argmax(rooms, axis=0), np.arange(len(mouths))
        return np.stack(rooms)[best, row] + EXIT_TOLERANCE_MM, np.stack(gradients)[best, row]

    def mouth_rooms(self, mouths: Float) -> list[tuple[Float, Float]]:
        """Return how far points are inside what is allowed for the mouths of channels.

        Args:
            mouths: Points (n, 3), mm.

        Returns:
            For exits and for walls from pads to kept regions, where they apply: distances (n,) mm,
            negative where a mouth is not allowed, and gradients (n, 3).
        """
        rooms = [self.exit_room(mouths)] if self.exits else []
        if self.pad[0] and self.kept_whole:
            room, gradient = self.room_to_kept(mouths)
            rooms.append((room + self.channel_diameter / 2 - self.pad_reach, gradient))
        return rooms

    def room_to_kept(self, points: Float) -> tuple[Float, Float]:
        """Return how far points are from what channels may come near to around kept regions.

        Args:
            points: Points (n, 3), mm.

        Returns:
            Distances (n,) mm, negative where a channel would be too near; infinite without kept
            regions. Gradients (n, 3).
        """
        room, gradient = np.full(len(points), np.inf), np.zeros((len(points), 3))
        for shape in self.kept_whole:
            inside, inward = inset(shape, points)
            is_nearer = -inside - self.depth < room
            room = np.where(is_nearer, -inside - self.depth, room)
            gradient = np.where(is_nearer[:, None], -inward, gradient)
        return room, gradient

    @property
    def depth(self) -> float:
        """Smallest distance of a cord's center line from the surface."""
        return self.wall + self.channel_diameter / 2


@dataclass(frozen=True)
class Problem:
    """The simulated states of a body, the outputs to predict and the cords that may sense them.

    Attributes:
        surface: The body's surface at rest.
        locator: Locator of the mesh.
        fields: (s, n, 3) mm, displacements of the nodes in s states, without rest.
        markers: (s + 1, k, 3) mm, displacements of the markers, rest first.
        marker_weights: (k,), weights that sum to one.
        sense: How cords sense.
        noise: Standard deviation of (R - R0)/R0 of a long cord.
        limits: What layouts must keep.
        decoder: Kind of the decoder.

    Raises:
        LayoutError: If a value is not finite or no state moves a marker.
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

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled: the fields alone, since computed tables are large."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def with_decoder(self, kind: str) -> Problem:
        """Return the same problem for another decoder, sharing what is already computed."""
        out = replace(self, decoder=kind)
        computed = {"carrier", "depth", "grid", "outputs"} & vars(self).keys()
        vars(out).update({k: vars(self)[k] for k in computed})
        return out

    def features(self, cords: int) -> Features:
        """Return the decoder's features of the signals of so many cords."""
        return FEATURES[self.decoder](cords)

    @cached_property
    def carrier(self) -> CordCarrier:
        """Carrier that moves cords with the fields; computed once, since its tables are large."""
        return CordCarrier(self.locator, self.fields, self.sense)

    @cached_property
    def depth(self) -> SignedDistance:
        """Function for the exact depth below the surface."""
        return signed_distance_of(self.surface)

    @cached_property
    def grid(self) -> DepthGrid:
        """Depth interpolated on a grid, for very many points."""
        return DepthGrid(self.surface)

    @cached_property
    def outputs(self) -> Float:
        """Centred outputs (s + 1, r), reduced by SVD to at most s + 1 columns."""
        return reduce_outputs(self.markers, self.marker_weights)

    def deform(self, points: Float) -> Float:
        """Return deformed positions (s, ..., 3) mm of rest points (..., 3) mm."""
        moved = self.carrier.move(points.reshape(-1, 3))
        return moved.reshape(len(self.fields), *points.shape)

    def signals(self, points: Float) -> Float:
        """Return the signals of polylines, all with the same `noise` (see `SignalModel`).

        Args:
            points: Polylines (..., p, 3) mm at rest.

        Returns:
            Signals (s + 1, ...), the zero of rest first.
        """
        shape = points.shape[:-2]
        moved = self.carrier.signals(points.reshape(-1, *points.shape[-2:]))
        return np.concatenate([np.zeros((1, *shape)), moved.reshape(len(self.fields), *shape)])

    def floor(self, sensors: int) -> float:
        """Return the smallest RMSE (mm) of an affine map of so many signals without noise."""
        return affine_error_floor(self.outputs, sensors)

    def expected_error(self, signals: Float) -> Float:
        """Return the expected RMSE (mm) of the best decoder under noise.

        Args:
            signals: Sets of signals (..., n, c) of n states, rest first, and c cords.

        Returns:
            RMSE (...,) of each set.
        """
        features = self.features(signals.shape[-1])
        square = expected_square(features, signals, self.outputs, self.noise)
        return np.asarray(np.sqrt(np.maximum(square, 0) / len(self.markers)))


def reduce_outputs(markers: Float, weights: Float) -> Float:
    """Reduce marker displacements to few centered outputs.

    Args:
        markers: Displacements (n, k, 3) mm.
        weights: Weights (k,) that sum to one.

    Returns:
        Outputs (n, r) with r at most n. The squared norm of a row is the weighted mean squared
        distance of the state's markers from the mean state.
    """
    flat = (markers * np.sqrt(weights)[:, None]).reshape(len(markers), -1)
    u, s, _ = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
    return np.asarray(u * s)
