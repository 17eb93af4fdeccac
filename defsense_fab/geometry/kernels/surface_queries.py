"""How deep points lie below a body's skin."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import cached_property
from typing import Any, Generic, TypeVar

import igl
import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.curve import Plane
from ...core.mesh import Surface

T = TypeVar("T")


class SurfaceCache(Generic[T]):
    """What `make` gives for a surface, kept as long as that surface (by its identity) is; it must
    not keep the surface itself."""

    def __init__(self, make: Callable[[Surface], T]) -> None:
        self._make = make
        self._known: dict[int, tuple[weakref.ref[Surface], T]] = {}

    def __call__(self, surface: Surface) -> T:
        key = id(surface)
        found = self._known.get(key)
        if found is not None and found[0]() is surface:
            return found[1]
        made = self._make(surface)
        gone = weakref.ref(surface, lambda _: self._known.pop(key, None))
        self._known[key] = (gone, made)
        return made


# Points of a body's skin with their normals.

_WITHIN = 20


def samples(body: Surface, size: float) -> tuple[Float, Float]:
    """Points (n, 3) mm spread over the skin, about 20 within a square of `size` mm unless
    the body is large, and its unit normals there (n, 3)."""
    a, b, c = (body.vertices[body.faces[:, i]] for i in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    count = int(np.clip(_WITHIN * area / size**2, 1000, 30_000))
    points = body.scatter(count, np.random.default_rng(1))
    _, face, _ = igl.point_mesh_squared_distance(points, body.vertices, body.faces)
    a, b, c = (body.vertices[body.faces[np.asarray(face)][:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    return points, normal / np.linalg.norm(normal, axis=1, keepdims=True)


# Where a plane cuts a body's surface.


def plane_section(surface: Surface, plane: Plane) -> Float:
    """The outline as unordered segments (m, 2, 2) mm in the plane's frame; none where the plane
    misses the body. A facet that lies in the plane gives none: its neighbours do."""
    local = (surface.vertices - plane.origin) @ plane.axes
    above = local[:, 2] > 0
    count = above[surface.faces].sum(1)
    crossed = np.flatnonzero((count == 1) | (count == 2))
    corners = local[surface.faces[crossed]]
    side = above[surface.faces[crossed]]
    # The corner that is alone on its side: both crossings are on its edges.
    alone = np.where(side.sum(1) == 1, side.argmax(1), (~side).argmax(1))
    row = np.arange(len(crossed))
    one = corners[row, alone]
    ends = []
    for turn in (1, 2):
        other = corners[row, (alone + turn) % 3]
        share = one[:, 2] / (one[:, 2] - other[:, 2])
        ends.append(one[:, :2] + share[:, None] * (other - one)[:, :2])
    return np.stack(ends, axis=1) if len(crossed) else np.zeros((0, 2, 2))


def inside_section(section: Float, points: Float) -> np.ndarray:
    """Which points (q, 2) mm lie inside of the outline (m, 2, 2): a ray to the right crosses it an
    odd number of times."""
    a, b = section[:, 0], section[:, 1]
    x, y = points[:, None, 0], points[:, None, 1]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    at = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
    return np.asarray((spans & (x < at)).sum(1) % 2 == 1)


def nearest_on_section(section: Float, point: Float) -> Float:
    """The point (2,) of the outline (m, 2, 2), m >= 1, that is nearest to one."""
    a, along = section[:, 0], section[:, 1] - section[:, 0]
    square = np.maximum((along**2).sum(1), 1e-18)
    t = np.clip(((point - a) * along).sum(1) / square, 0, 1)
    places = a + t[:, None] * along
    return np.asarray(places[((places - point) ** 2).sum(1).argmin()])


# Where a ray meets a triangle surface.


def hits(origin: Float, direction: Float, surface: Surface) -> Float:
    """Distances (k,) mm, ascending, from `origin` (3,) along `direction` (3,) to the facets that
    the ray meets, edges shared by two facets once (Moeller & Trumbore 1997)."""
    d = direction / np.linalg.norm(direction)
    near = _balls_of(surface).met(origin, d)
    a, b, c = (surface.vertices[surface.faces[near, i]] for i in range(3))
    e1, e2 = b - a, c - a
    h = np.cross(d, e2)
    det = np.einsum("ij,ij->i", e1, h)
    ok = np.abs(det) > 1e-12
    inv = 1 / np.where(ok, det, 1)
    s = origin - a
    u = inv * np.einsum("ij,ij->i", s, h)
    q = np.cross(s, e1)
    v = inv * (q @ d)
    t = inv * np.einsum("ij,ij->i", e2, q)
    hit = ok & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t > -1e-9)
    found = np.sort(t[hit])
    return np.asarray(found[np.diff(found, prepend=-np.inf) > 1e-6])


class _Balls:
    """A ball around each triangle: most are far from a ray, and are left out by that."""

    def __init__(self, surface: Surface) -> None:
        corners = surface.vertices[surface.faces]
        self._middle = corners.mean(axis=1)
        radius = np.linalg.norm(corners - self._middle[:, None], axis=2).max(axis=1)
        self._squared = (self._middle**2).sum(axis=1)
        size = float(np.abs(surface.vertices).max())
        self._reach, self._margin = radius**2 * (1 + 1e-6), 1e-9 * (1 + size) ** 2

    def met(self, origin: Float, d: Float) -> Int:
        """The triangles whose balls meet the line through `origin` along the unit vector `d`."""
        along = self._middle @ d - origin @ d
        squared = self._squared - 2 * (self._middle @ origin) + origin @ origin
        margin = self._margin + 1e-9 * float(origin @ origin)
        return np.flatnonzero(squared - along**2 <= self._reach + margin)


#: Rays come by the thousand.
_balls_of = SurfaceCache(_Balls)


def find_exit(start: Float, out: Float, body: Surface, most: float) -> tuple[float, float]:
    """From a point in the body along `out`: how far to the skin, and how far a tool may go on, up
    to `most` mm beyond it but only half way to where the body begins again."""
    found = hits(start, out, body)
    inlet = float(found[0]) if len(found) else 0.0
    again = found[found > inlet + 0.1]
    return inlet, inlet + min(most, (again[0] - inlet) / 2 if len(again) else most)


# What is made of a surface once, and asked for many times: search trees, solids.


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
signed_distance_of = SurfaceCache(SignedDistance)
