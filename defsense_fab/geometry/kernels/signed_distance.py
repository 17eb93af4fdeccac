"""How deep points lie below a body's skin."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import igl
import numpy as np

from ...core.arrays import Bool, Float
from ...core.mesh import Surface
from .made_once import MadeOnce

_ON_FACET = 1e-9  # mm; a point so near has the facet's normal for its gradient


class SignedDistance:
    """Of one body: its search trees are made when they are first needed, once, and take most of the
    time of a single call."""

    def __init__(self, surface: Surface) -> None:
        self._v = np.ascontiguousarray(surface.vertices)
        self._f = np.ascontiguousarray(surface.faces)

    @cached_property
    def _tree(self) -> Any:
        tree = igl.AABB()
        tree.init(self._v, self._f)
        return tree

    @cached_property
    def _inward(self) -> Float:
        a, b, c = (self._v[self._f[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        return np.asarray(-normal / np.maximum(np.linalg.norm(normal, axis=1)[:, None], 1e-30))

    @cached_property
    def _winding(self) -> Any:
        tree = igl.FastWindingNumberBVH()
        tree.init(self._v, self._f)
        return tree

    def __call__(self, points: Float) -> Float:
        """Distance (q,) mm of points (q, 3) to the facets, negative outside by the winding
        number."""
        distance = self.unsigned(points)
        return np.asarray(np.where(self.sides(points, distance), distance, -distance))

    def with_gradient(self, points: Float) -> tuple[Float, Float]:
        """The same, and its gradient (q, 3) with the points."""
        q = np.ascontiguousarray(points)
        square, facet, nearest = self._tree.squared_distance(self._v, self._f, q)
        distance = np.sqrt(np.asarray(square))
        signed = np.where(self.sides(q, distance), distance, -distance)
        away = q - np.asarray(nearest)
        size = np.linalg.norm(away, axis=1, keepdims=True)
        gradient = np.where(
            size > _ON_FACET,
            away / np.maximum(size, _ON_FACET) * np.sign(signed)[:, None],
            self._inward[np.asarray(facet)],
        )
        return signed, gradient

    def sides(self, points: Float, distance: Float) -> Bool:
        """Which points (q, 3), at a distance (q,) mm, lie inside. That takes some ten times as long
        as the distance, but of points along a path: where the skin is further away than the next
        point, both are on one side of it, and one winding number tells of them."""
        if not len(points):
            return np.zeros(0, bool)
        step = np.linalg.norm(np.diff(points, axis=0), axis=1)
        apart = ~(step < np.maximum(distance[1:], distance[:-1]))  # also where one is no number
        run = np.concatenate([[0], np.cumsum(apart)])
        deepest = np.lexsort((-distance, run))[np.searchsorted(run, np.arange(run[-1] + 1))]
        return np.asarray(self.inside(points[deepest])[run])

    def unsigned(self, points: Float) -> Float:
        """Distance (q,) mm of points (q, 3) to the facets."""
        q = np.ascontiguousarray(points)
        return np.asarray(np.sqrt(self._tree.squared_distance(self._v, self._f, q)[0]))

    def nearest(self, points: Float) -> Float:
        """The points (q, 3) mm of the facets that are nearest to points (q, 3)."""
        q = np.ascontiguousarray(points)
        return np.array(self._tree.squared_distance(self._v, self._f, q)[2])

    def inside(self, points: Float) -> Bool:
        """Which points (q, 3) lie inside, by the winding number."""
        q = np.ascontiguousarray(points)
        return np.asarray(self._winding.winding_number(q) > 0.5)


#: Of a surface that is asked about again and again, its trees made once.
distances_of = MadeOnce(SignedDistance)
