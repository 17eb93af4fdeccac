"""What a plane through the body shows: how it is stretched there, in one state or over all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from ...core.arrays import Float, Int, format_point
from ...core.curve import Plane
from ...core.errors import LayoutError
from ...mechanics.elements import section
from ...mechanics.elements.point_location import LocatedPoints, PointLocator
from ...mechanics.elements.section import Section
from ...mechanics.elements.tet10 import boundary_faces
from ...mechanics.solver.fields import principal_stretches, stretch_along

Kind = Literal["along", "largest", "smallest"]
#: Of all places and states, so many are within the range that is shown: a few corners are far out.
_SHARE = 99.0
_INSIDE = -1e-9  # of a point's smallest weight
_CHUNK = 200_000  # gradients at once, 72 bytes each
_PLACES = 4000  # tets that tell how far a quantity reaches


@dataclass(frozen=True)
class Quantity:
    """What is shown: the stretch `along` a direction, the `largest` or the `smallest` principal
    stretch (lengths over rest lengths, without unit); or its variance over all states."""

    kind: Kind
    variance: bool = False


class BodySection:
    """Of a body whose states have displacements `fields` (s, n, 3) mm on the locator's mesh; state
    0 is rest, state k is `fields[k - 1]`, by their `names` (s + 1,)."""

    def __init__(self, locator: PointLocator, fields: Float, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._locator, self._fields = locator, fields

    @property
    def size(self) -> float:
        """The body's largest extent at rest, mm."""
        return float(np.ptp(self._locator.mesh.nodes, axis=0).max())

    def cut(self, plane: Plane) -> Section:
        """The plane's cut. Raises LayoutError where it misses the body."""
        found = section.cut(self._locator.mesh, plane.origin, plane.normal)
        if not len(found.triangles):
            away = (self._locator.mesh.nodes - plane.origin) @ plane.normal
            by = away.min() if away.min() > 0 else away.max()
            raise LayoutError(
                f"the plane through {format_point(plane.origin)} misses the body; move it by"
                f" {abs(by):.1f} mm or more {'along' if by >= 0 else 'against'} its normal"
                f" {format_point(plane.normal)}, or press X, Y or Z"
            )
        return found

    def grid(self, plane: Plane, step: float) -> tuple[Float, LocatedPoints]:
        """Points (p, 3) mm of a square grid in the plane that lie inside the body, `step` mm apart,
        and where they are in the tets; rows are the plane's x."""
        corners = self._locator.mesh.nodes - plane.origin
        local = corners @ plane.axes[:, :2]
        low, high = local.min(axis=0), local.max(axis=0)
        count = np.maximum(np.ceil((high - low) / step), 1).astype(int)
        first = (low + high - step * (count - 1)) / 2
        ticks = [f + step * np.arange(n) for f, n in zip(first, count, strict=True)]
        points = plane.to_world(np.stack(np.meshgrid(*ticks, indexing="ij"), -1).reshape(-1, 2))
        found = self._locator.find(points)
        inside = found.depth >= _INSIDE
        return points[inside], LocatedPoints(found.cell[inside], found.bary[inside])

    def half(self, plane: Plane) -> tuple[Float, Int]:
        """The surface behind the plane (against its normal), open at the cut: vertices (v, 3) mm at
        rest, triangles (f, 3)."""
        nodes, faces = self.skin
        slice_faces: Any = trimesh.intersections.slice_faces_plane
        vertices, triangles = slice_faces(nodes, faces, -plane.normal, plane.origin)[:2]
        return np.asarray(vertices, float), np.asarray(triangles, np.int64)

    @cached_property
    def skin(self) -> tuple[Float, Int]:
        """The mesh's surface with its nodes on edges: vertices (v, 3) mm at rest, and four
        triangles (f, 3) a face."""
        faces = boundary_faces(self._locator.mesh)
        parts = faces[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]].reshape(-1, 3)
        used, own = np.unique(parts, return_inverse=True)
        return self._locator.mesh.nodes[used], own.reshape(parts.shape)

    def positions(self, at: LocatedPoints, points: Float, state: int) -> Float:
        """Where rest `points` (p, 3) mm are in a state, (p, 3) mm."""
        if state == 0:
            return points
        moved = self._locator.displacement(at, self._fields[state - 1 : state])[0]
        return np.asarray(points + moved)

    def carried(self, points: Float, state: int) -> Float:
        """The same for points (p, 3) anywhere; those outside follow the nearest tet."""
        return points if state == 0 else self.positions(self._locator.find(points), points, state)

    def values(self, at: LocatedPoints, quantity: Quantity, state: int, direction: Float) -> Float:
        """The quantity (p,) at places: in a state, or its variance over rest and all states. The
        `direction` (3,) or (p, 3) of any length at rest is used by the kind `along` alone."""
        if not quantity.variance:
            return _measured(self._gradients(at, [state])[0], quantity.kind, direction)
        values = self._over_states(at, quantity.kind, direction)
        return np.asarray(values.var(axis=0))

    def spread(self, quantity: Quantity, state: int | None, direction: Float) -> float:
        """How far the quantity reaches within the whole body: the variance from 0, a stretch from 1
        either way; 99 % of all places and states (or of one `state`) are within. The `direction`
        is (3,), or one (k, 3) for each of the `middles`."""
        F = self._middle_gradients
        if not quantity.variance and state is not None:
            F = F[state : state + 1]
        values = _measured(F, quantity.kind, direction)
        far = values.var(axis=0) if quantity.variance else np.abs(values - 1)
        return float(np.percentile(far, _SHARE))

    @cached_property
    def middles(self) -> Float:
        """The middles (k, 3) mm of tets at rest, all or evenly some of them."""
        mesh = self._locator.mesh
        return np.asarray(mesh.nodes[mesh.cells[self._some, :4]].mean(axis=1))

    @cached_property
    def _middle_gradients(self) -> Float:
        at = LocatedPoints(self._some, np.full((len(self._some), 4), 0.25))
        return self._gradients(at, range(len(self.names)))

    @property
    def _some(self) -> Int:
        count = len(self._locator.mesh.cells)
        return np.arange(0, count, -(-count // _PLACES))

    def _over_states(self, at: LocatedPoints, kind: Kind, direction: Float) -> Float:
        """(s + 1, p), in parts that fit into memory."""
        out = np.empty((len(self.names), len(at.cell)))
        step = max(_CHUNK // len(self.names), 1)
        for first in range(0, len(at.cell), step):
            part = slice(first, first + step)
            some = LocatedPoints(at.cell[part], at.bary[part])
            own = direction if direction.ndim == 1 else direction[part]
            out[:, part] = _measured(self._gradients(some, range(len(self.names))), kind, own)
        return out

    def _gradients(self, at: LocatedPoints, states: Sequence[int]) -> Float:
        """Deformation gradients (s, p, 3, 3)."""
        moving = [k - 1 for k in states if k]
        every = len(moving) == len(self._fields)
        fields = self._fields if every else self._fields[moving]
        found = iter(self._locator.gradient(at, fields)) if moving else iter(())
        still = np.zeros((len(at.cell), 3, 3))
        return np.stack([next(found) if k else still for k in states]) + np.eye(3)


def _measured(F: Float, kind: Kind, direction: Float) -> Float:
    if kind == "along":
        return stretch_along(F, direction)
    stretches = principal_stretches(F)
    return np.asarray(stretches[..., 0 if kind == "largest" else -1])


def directions_along(path: Float, points: Float) -> Float:
    """Unit directions (p, 3) at points (p, 3): those of the path (q, 3) where it is nearest."""
    along = np.gradient(path, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return np.asarray(along[cKDTree(path).query(points)[1]])
