"""How deep points lie below a body's skin."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import igl
import numpy as np

from ...core.arrays import Bool, Float
from ...core.mesh import Surface
from .made_once import MadeOnce


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
    def _winding(self) -> Any:
        tree = igl.FastWindingNumberBVH()
        tree.init(self._v, self._f)
        return tree

    def __call__(self, points: Float) -> Float:
        """Distance (q,) mm of points (q, 3) to the facets, negative outside by the winding
        number."""
        distance = self.unsigned(points)
        return np.asarray(np.where(self.inside(points), distance, -distance))

    def along(self, path: Float) -> Float:
        """The same of a path (q, 3) whose points lie close: where the skin is further away than the
        next point, both are on one side of it, and one winding number tells of them."""
        distance = self.unsigned(path)
        step = np.linalg.norm(np.diff(path, axis=0), axis=1)
        apart = step >= np.maximum(distance[1:], distance[:-1])
        run = np.concatenate([[0], np.cumsum(apart)])
        deepest = np.lexsort((-distance, run))[np.searchsorted(run, np.arange(run[-1] + 1))]
        inside = self.inside(path[deepest])[run]
        return np.asarray(np.where(inside, distance, -distance))

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
