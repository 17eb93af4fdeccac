"""Where a ray meets a triangle surface."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ...core.mesh import Surface
from .made_once import MadeOnce


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
_balls_of = MadeOnce(_Balls)


def way_out(start: Float, out: Float, body: Surface, most: float) -> tuple[float, float]:
    """From a point in the body along `out`: how far to the skin, and how far a tool may go on, up
    to `most` mm beyond it but only half way to where the body begins again."""
    found = hits(start, out, body)
    inlet = float(found[0]) if len(found) else 0.0
    again = found[found > inlet + 0.1]
    return inlet, inlet + min(most, (again[0] - inlet) / 2 if len(again) else most)
