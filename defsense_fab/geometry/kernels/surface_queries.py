"""Answer geometric queries on triangle surfaces: signed distances, rays, plane sections and
samples.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Generic, TypeVar

import igl
import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.curve import Plane
from ...core.mesh import Surface, facet_crosses

T = TypeVar("T")


class SurfaceCache(Generic[T]):
    """A value computed once for each surface.

    The value is kept as long as the surface (by its identity) exists; it must not refer to the
    surface.

    Args:
        make: Computes the value.
    """

    def __init__(self, make: Callable[[Surface], T]) -> None:
        self._make = make
        self._values: dict[int, tuple[weakref.ref[Surface], T]] = {}

    def __call__(self, surface: Surface) -> T:
        key = id(surface)
        entry = self._values.get(key)
        if entry is not None and entry[0]() is surface:
            return entry[1]
        value = self._make(surface)
        reference = weakref.ref(surface, lambda _: self._values.pop(key, None))
        self._values[key] = (reference, value)
        return value


POINTS_PER_SQUARE = 20


def sample_skin(body: Surface, size: float) -> tuple[Float, Float]:
    """Return points spread over a skin, with its normals.

    Args:
        body: Surface of the body.
        size: Side of a square that should hold about 20 points, mm. Large bodies get fewer.

    Returns:
        Points (n, 3), mm, and unit normals (n, 3).
    """
    count = int(np.clip(POINTS_PER_SQUARE * body.area / size**2, 1000, 30_000))
    points = body.scatter(count, np.random.default_rng(1))
    return points, body.normals[signed_distance_of(body).closest(points)[1]]


def distance_to_chosen(points: Float, chosen: Float) -> Float:
    """Return the distance (n,) of points from those chosen before, for farthest-point sampling.

    Args:
        points: Points (n, d).
        chosen: Chosen points (k, d). Without any, the distance is that from the points' center.
    """
    if not len(chosen):
        return np.asarray(np.linalg.norm(points - points.mean(axis=0), axis=1))
    return np.asarray(np.linalg.norm(points[:, None] - chosen, axis=2).min(axis=1))


def plane_section(surface: Surface, plane: Plane) -> Float:
    """Cut a surface with a plane.

    Args:
        surface: The surface.
        plane: The plane.

    Returns:
        The outline as unordered segments (m, 2, 2) in the plane's frame, mm; (0, 2, 2) if the plane
        misses the surface. A facet that lies in the plane gives none: its neighbors do.
    """
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


def inside_section(section: Float, points: Float) -> Bool:
    """Return which points lie inside an outline: a ray to the right crosses it an odd number of
    times.

    Args:
        section: Outline (m, 2, 2) of `plane_section`, mm.
        points: Points (q, 2), mm.
    """
    a, b = section[:, 0], section[:, 1]
    x, y = points[:, :1], points[:, 1:]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    at = a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    return np.asarray((spans & (x < at)).sum(1) % 2 == 1)


def inside_outlines(points: Float, polygons: Sequence[Float]) -> Bool:
    """Return which points (q, 2) lie inside closed outlines (k, 2), of which inner ones are
    holes.
    """
    segments = [np.stack([p, np.roll(p, -1, axis=0)], axis=1) for p in polygons]
    return inside_section(np.concatenate([np.zeros((0, 2, 2)), *segments]), points)


def nearest_on_section(section: Float, point: Float) -> Float:
    """Return the point (2,) of the outline (m, 2, 2), m >= 1, nearest to `point` (2,)."""
    a, along = section[:, 0], section[:, 1] - section[:, 0]
    square = np.maximum((along**2).sum(1), 1e-18)
    t = np.clip(((point - a) * along).sum(1) / square, 0, 1)
    places = a + t[:, None] * along
    return np.asarray(places[((places - point) ** 2).sum(1).argmin()])


def cast_ray(origin: Float, direction: Float, surface: Surface) -> Float:
    """Return the distances at which a ray meets a surface.

    Args:
        origin: Start (3,) of the ray, mm.
        direction: Direction (3,), of any length.
        surface: The surface.

    Returns:
        Distances (k,), mm, ascending. An edge that two facets share counts once.

    References:
        Moeller & Trumbore (1997), Fast, minimum storage ray/triangle intersection.
    """
    d = direction / np.linalg.norm(direction)
    candidates = _cached_balls(surface).meeting(origin, d)
    a, b, c = (surface.vertices[surface.faces[candidates, i]] for i in range(3))
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
    distances = np.sort(t[hit])
    return np.asarray(distances[np.diff(distances, prepend=-np.inf) > 1e-6])


class _Balls:
    """A ball around each triangle, to exclude most triangles of a ray quickly."""

    def __init__(self, surface: Surface) -> None:
        corners = surface.vertices[surface.faces]
        self._middle = corners.mean(axis=1)
        radius = np.linalg.norm(corners - self._middle[:, None], axis=2).max(axis=1)
        self._squared = (self._middle**2).sum(axis=1)
        size = float(np.abs(surface.vertices).max())
        self._reach, self._margin = radius**2 * (1 + 1e-6), 1e-9 * (1 + size) ** 2

    def meeting(self, origin: Float, d: Float) -> Int:
        """Return the triangles whose balls meet the line through `origin` along the unit vector
        `d`.
        """
        along = self._middle @ d - origin @ d
        squared = self._squared - 2 * (self._middle @ origin) + origin @ origin
        margin = self._margin + 1e-9 * float(origin @ origin)
        return np.flatnonzero(squared - along**2 <= self._reach + margin)


#: Rays come by the thousand.
_cached_balls = SurfaceCache(_Balls)


def find_exit(start: Float, out: Float, body: Surface, max_run: float) -> tuple[float, float]:
    """Find where a tool leaves a body.

    Args:
        start: Point (3,) in the body, mm.
        out: Direction (3,) of the tool.
        body: Surface of the body.
        max_run: Largest run beyond the skin, mm.

    Returns:
        The distance to the skin, and how far the tool may run: up to `max_run` beyond the skin but
        only half way to where the body starts again, mm.
    """
    distances = cast_ray(start, out, body)
    inlet = float(distances[0]) if len(distances) else 0.0
    reentries = distances[distances > inlet + 0.1]
    return inlet, inlet + min(max_run, (reentries[0] - inlet) / 2 if len(reentries) else max_run)


ON_FACET_MM = 1e-9  # mm; a point so near has the facet's normal for its gradient


class SignedDistance:
    """Distances to a surface, and winding numbers, for which it may have holes or crossings.

    Its search trees are built once, when they are first needed; they take most of the time of a
    single call.
    """

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
        normal = facet_crosses(self._v, self._f)
        return np.asarray(-normal / np.maximum(np.linalg.norm(normal, axis=1)[:, None], 1e-30))

    @cached_property
    def _winding(self) -> Any:
        tree = igl.FastWindingNumberBVH()
        tree.init(self._v, self._f)
        return tree

    def __call__(self, points: Float) -> Float:
        """Return the distance (q,), mm, of points (q, 3) to the facets; negative outside by the
        winding number.
        """
        distance = self.unsigned(points)
        return np.asarray(np.where(self.sides(points, distance), distance, -distance))

    def with_gradient(self, points: Float) -> tuple[Float, Float]:
        """Return the same distances (q,), mm, and their gradients (q, 3)."""
        distance, facet, nearest = self.closest(points)
        signed = np.where(self.sides(points, distance), distance, -distance)
        away = points - nearest
        size = np.linalg.norm(away, axis=1, keepdims=True)
        gradient = np.where(
            size > ON_FACET_MM,
            away / np.maximum(size, ON_FACET_MM) * np.sign(signed)[:, None],
            self._inward[facet],
        )
        return signed, gradient

    def sides(self, points: Float, distance: Float) -> Bool:
        """Return which points (q, 3), at distances (q,) mm from the surface, lie inside.

        A winding number takes some ten times as long as a distance. Along a path, where the skin is
        farther away than the next point, both points are on the same side and share one winding
        number.
        """
        if not len(points):
            return np.zeros(0, bool)
        step = np.linalg.norm(np.diff(points, axis=0), axis=1)
        # The comparison is False for NaN, which therefore starts a new run.
        is_new_run = ~(step < np.maximum(distance[1:], distance[:-1]))
        run = np.concatenate([[0], np.cumsum(is_new_run)])
        deepest = np.lexsort((-distance, run))[np.searchsorted(run, np.arange(run[-1] + 1))]
        return np.asarray(self.inside(points[deepest])[run])

    def closest(self, points: Float) -> tuple[Float, Int, Float]:
        """Return the distance (q,), mm, of points (q, 3) to the facets, the nearest facet (q,), and
        its nearest point (q, 3).
        """
        q = np.ascontiguousarray(points)
        square, facet, nearest = self._tree.squared_distance(self._v, self._f, q)
        distance = np.sqrt(np.asarray(square)).reshape(-1)
        return distance, np.asarray(facet).reshape(-1), np.asarray(nearest).reshape(-1, 3)

    def unsigned(self, points: Float) -> Float:
        """Return the distance (q,), mm, of points (q, 3) to the facets."""
        return self.closest(points)[0]

    def nearest(self, points: Float) -> Float:
        """Return the points (q, 3) of the facets nearest to points (q, 3), mm."""
        return np.array(self.closest(points)[2])

    def winding(self, points: Float) -> Float:
        """Return the winding number (q,) at points (q, 3).

        References:
            Jacobson et al. (2013); Barill et al. (2018).
        """
        return np.asarray(self._winding.winding_number(np.ascontiguousarray(points))).reshape(-1)

    def inside(self, points: Float) -> Bool:
        """Return which points (q, 3) lie inside: those with a winding number above 0.5."""
        return self.winding(points) > 0.5


#: Queries of one surface come repeatedly.
signed_distance_of = SurfaceCache(SignedDistance)
