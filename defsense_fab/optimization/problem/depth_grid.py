"""Interpolate the depth below the body's surface on a grid, for the many points of candidates."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import ndimage

from ...core.arrays import Float
from ...core.machine import kernels
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import signed_distance_of

_MAX_NODES, _MIN_SPACING_MM = 60_000, 1.0
_CHUNK_NODES = 250  # evaluated in one call


class DepthGrid:
    """Depth below a surface, interpolated on a regular grid.

    Args:
        surface: The body's surface.

    Attributes:
        spacing: Distance of neighboring nodes, mm.
        origin: (3,) mm, the first node.
        depths: (i, j, k) mm, exact depth at the nodes, negative outside the body.
    """

    def __init__(self, surface: Surface) -> None:
        low, high = surface.bounds
        self.spacing = max(float(np.cbrt(np.prod(high - low) / _MAX_NODES)), _MIN_SPACING_MM)
        count = np.ceil((high - low) / self.spacing).astype(int) + 3
        self.origin = (low + high) / 2 - self.spacing * (count - 1) / 2
        ticks = [a + self.spacing * np.arange(n) for a, n in zip(self.origin, count, strict=True)]
        nodes = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1)
        exact = signed_distance_of(surface)
        distance = _evaluate_in_chunks(exact.unsigned, nodes.reshape(-1, 3)).reshape(count)
        # There is no surface between neighbors that are both more than half a step away from it:
        # one node of each connected component decides for all of them.
        component, count_components = ndimage.label(distance > 0.51 * self.spacing)
        first = np.unique(component, return_index=True)[1] if count_components else np.zeros(0, int)
        tested = np.union1d(np.flatnonzero(component == 0), first)
        inside = np.zeros(component.size, bool)
        inside[tested] = _evaluate_in_chunks(exact.inside, nodes.reshape(-1, 3)[tested])
        is_inside = np.zeros(count_components + 1, bool)
        is_inside[component.ravel()[first]] = inside[first]
        inside = np.where(component.ravel() > 0, is_inside[component.ravel()], inside).reshape(
            count
        )
        self.depths = np.ascontiguousarray(np.where(inside, distance, -distance))

    @property
    def error(self) -> float:
        """Approximate error next to an edge of the body, mm."""
        return self.spacing / 4

    def __call__(self, points: Float) -> Float:
        """Return the depth (...,) mm at points (..., 3) mm, negative outside the body and grid."""
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        depths = np.empty(len(flat))
        kernels.interpolate_depth(self.depths, self.origin, self.spacing, flat, depths)
        return np.asarray(depths.reshape(points.shape[:-1]))

    def exits(self, points: Float, directions: Float, longest: float) -> Float:
        """Return the distances after which rays leave the body.

        Args:
            points: Starts (c, 3) mm inside the body.
            directions: Unit directions (c, 3).
            longest: Largest distance of interest, mm.

        Returns:
            Distances (c,) mm, infinite where they exceed `longest`.
        """
        out = np.empty(len(points))
        kernels.find_exits(
            self.depths,
            self.origin,
            self.spacing,
            np.ascontiguousarray(points),
            np.ascontiguousarray(directions),
            longest,
            out,
        )
        return out


def _evaluate_in_chunks(function: Callable[[Float], Any], points: Float) -> Any:
    """Evaluate a function of points (p, 3) in chunks.

    libigl holds the interpreter, so that other threads would wait for the whole evaluation.
    """
    return np.concatenate(
        [function(points[k : k + _CHUNK_NODES]) for k in range(0, len(points), _CHUNK_NODES)]
    )
