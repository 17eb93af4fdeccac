"""Compute the stretch of the body on a plane section, in one state or over all states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, Int, format_point
from ...core.curve import Plane
from ...core.errors import LayoutError
from ...mechanics.elements import section
from ...mechanics.elements.point_location import LocatedPoints as LocatedPoints
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.section import Section as Section
from ...mechanics.elements.tet10 import boundary_faces
from ...mechanics.solver.fields import principal_stretches, stretch_along

Kind = Literal["along", "largest", "smallest"]
_RANGE_PERCENTILE = 99.0  # of all places and states in the displayed range; corners are outliers
_INSIDE_TOLERANCE = -1e-9  # of a point's smallest barycentric coordinate
_CHUNK_GRADIENTS = 200_000  # computed at once, 72 bytes each
_SAMPLED_TETS = 4000  # to find the range of a quantity


@dataclass(frozen=True)
class Quantity:
    """A quantity on a section: a stretch (length over rest length) or its variance.

    Attributes:
        kind: Stretch `along` a direction, or the `largest` or `smallest` principal stretch.
        variance: Whether it is the variance over all states.
    """

    kind: Kind
    variance: bool = False


class BodySection:
    """Plane sections of a body in its states; state 0 is rest.

    Args:
        locator: Locator of the mesh.
        fields: Displacements (s, n, 3) mm; state k is `fields[k - 1]`.
        names: Names (s + 1,) of the states, rest first.

    Attributes:
        names: The same names.
    """

    def __init__(self, locator: PointLocator, fields: Float, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._locator, self._fields = locator, fields

    @property
    def size(self) -> float:
        """The body's largest extent at rest, mm."""
        return float(np.ptp(self._locator.mesh.nodes, axis=0).max())

    def cut(self, plane: Plane) -> Section:
        """Cut the body by a plane.

        Raises:
            LayoutError: If the plane misses the body.
        """
        cut_section = section.cut(self._locator.mesh, plane.origin, plane.normal)
        if not len(cut_section.triangles):
            height = (self._locator.mesh.nodes - plane.origin) @ plane.normal
            shift = height.min() if height.min() > 0 else height.max()
            raise LayoutError(
                f"the plane through {format_point(plane.origin)} misses the body",
                code="plane-misses-body",
                action=f"Move it by {abs(shift):.1f} mm or more"
                f" {'along' if shift >= 0 else 'against'} its normal {format_point(plane.normal)}",
                distance=float(shift),
            )
        return cut_section

    def grid(self, plane: Plane, step: float) -> tuple[Float, LocatedPoints]:
        """Return the points of a square grid in a plane that lie inside the body.

        Args:
            plane: The plane; rows of the grid follow its x axis.
            step: Distance of neighboring points, mm.

        Returns:
            Points (p, 3) mm and their places in the tets.
        """
        corners = self._locator.mesh.nodes - plane.origin
        local = corners @ plane.axes[:, :2]
        low, high = local.min(axis=0), local.max(axis=0)
        count = np.maximum(np.ceil((high - low) / step), 1).astype(int)
        first = (low + high - step * (count - 1)) / 2
        ticks = [f + step * np.arange(n) for f, n in zip(first, count, strict=True)]
        points = plane.to_world(np.stack(np.meshgrid(*ticks, indexing="ij"), -1).reshape(-1, 2))
        located = self._locator.find(points)
        inside = located.depth >= _INSIDE_TOLERANCE
        return points[inside], LocatedPoints(located.cell[inside], located.bary[inside])

    def half(self, plane: Plane) -> tuple[Float, Int]:
        """Return the surface behind the plane (against its normal), open at the cut.

        Returns:
            Vertices (v, 3) mm at rest and triangles (f, 3).
        """
        import trimesh  # slow, and needed when the body is cut only

        nodes, faces = self.skin
        slice_faces: Any = trimesh.intersections.slice_faces_plane
        vertices, triangles = slice_faces(nodes, faces, -plane.normal, plane.origin)[:2]
        return np.asarray(vertices, float), np.asarray(triangles, np.int64)

    @cached_property
    def skin(self) -> tuple[Float, Int]:
        """Surface of the mesh, edge nodes included: vertices (v, 3) mm, four triangles per face."""
        faces = boundary_faces(self._locator.mesh)
        parts = faces[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]].reshape(-1, 3)
        used, own = np.unique(parts, return_inverse=True)
        return self._locator.mesh.nodes[used], own.reshape(parts.shape)

    def positions(self, at: LocatedPoints, points: Float, state: int) -> Float:
        """Return the positions (p, 3) mm of located rest points (p, 3) mm in a state."""
        if state == 0:
            return points
        moved = self._locator.displacement(at, self._fields[state - 1 : state])[0]
        return np.asarray(points + moved)

    def carried(self, points: Float, state: int) -> Float:
        """Return the positions (p, 3) mm of any points; those outside follow the nearest tet."""
        return points if state == 0 else self.positions(self._locator.find(points), points, state)

    def values(self, at: LocatedPoints, quantity: Quantity, state: int, direction: Float) -> Float:
        """Return a quantity (p,) at points.

        Args:
            at: The located points (p).
            quantity: The quantity; a variance is over rest and all states.
            state: Number of the state, ignored for a variance.
            direction: Rest direction (3,) or (p, 3) of any length, for the kind `along`.
        """
        if not quantity.variance:
            return _measure(self._gradients(at, [state])[0], quantity.kind, direction)
        values = self._over_states(at, quantity.kind, direction)
        return np.asarray(values.var(axis=0))

    def spread(self, quantity: Quantity, state: int | None, direction: Float) -> float:
        """Return the range of a quantity in the whole body, for a color scale.

        It holds 99 % of all places and states: the variance from 0, or the deviation of a stretch
        from 1.

        Args:
            quantity: The quantity.
            state: Number of the only state to consider; all by default.
            direction: Rest direction (3,), or (k, 3) at the `middles`.
        """
        values = self._middle_values(quantity, state, direction)
        deviation = values if quantity.variance else np.abs(values - 1)
        return float(np.percentile(deviation, _RANGE_PERCENTILE))

    def span(self, quantity: Quantity, state: int | None, direction: Float) -> tuple[float, float]:
        """Return the smallest and largest value of a quantity in 99 % of the body.

        The arguments are those of `spread`.
        """
        values = self._middle_values(quantity, state, direction)
        outside = (100 - _RANGE_PERCENTILE) / 2
        low, high = np.percentile(values, [outside, 100 - outside])
        return float(low), float(high)

    def _middle_values(self, quantity: Quantity, state: int | None, direction: Float) -> Float:
        """Return a stretch (s, k) at the `middles`, or its variance (k,)."""
        F = self._middle_gradients
        if not quantity.variance and state is not None:
            F = F[state : state + 1]
        values = _measure(F, quantity.kind, direction)
        return np.asarray(values.var(axis=0)) if quantity.variance else values

    @cached_property
    def middles(self) -> Float:
        """Centers (k, 3) mm at rest of all tets, or of evenly chosen ones if there are many."""
        mesh = self._locator.mesh
        return np.asarray(mesh.nodes[mesh.cells[self._some, :4]].mean(axis=1))

    @cached_property
    def _middle_gradients(self) -> Float:
        at = LocatedPoints(self._some, np.full((len(self._some), 4), 0.25))
        return self._gradients(at, range(len(self.names)))

    @property
    def _some(self) -> Int:
        count = len(self._locator.mesh.cells)
        return np.arange(0, count, -(-count // _SAMPLED_TETS))

    def _over_states(self, at: LocatedPoints, kind: Kind, direction: Float) -> Float:
        """Return the stretch (s + 1, p) in all states, computed in chunks that fit into memory."""
        out = np.empty((len(self.names), len(at.cell)))
        step = max(_CHUNK_GRADIENTS // len(self.names), 1)
        for first in range(0, len(at.cell), step):
            part = slice(first, first + step)
            points = LocatedPoints(at.cell[part], at.bary[part])
            directions = direction if direction.ndim == 1 else direction[part]
            out[:, part] = _measure(
                self._gradients(points, range(len(self.names))), kind, directions
            )
        return out

    def _gradients(self, at: LocatedPoints, states: Sequence[int]) -> Float:
        """Return the deformation gradients (s, p, 3, 3)."""
        moving = [k - 1 for k in states if k]
        is_all = len(moving) == len(self._fields)
        fields = self._fields if is_all else self._fields[moving]
        gradients = iter(self._locator.gradient(at, fields)) if moving else iter(())
        rest = np.zeros((len(at.cell), 3, 3))
        return np.stack([next(gradients) if k else rest for k in states]) + np.eye(3)


def _measure(F: Float, kind: Kind, direction: Float) -> Float:
    if kind == "along":
        return stretch_along(F, direction)
    stretches = principal_stretches(F)
    return np.asarray(stretches[..., 0 if kind == "largest" else -1])


def directions_along(path: Float, points: Float) -> Float:
    """Return the unit directions (p, 3) of a path (q, 3) nearest to points (p, 3)."""
    along = np.gradient(path, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return np.asarray(along[cKDTree(path).query(points)[1]])
