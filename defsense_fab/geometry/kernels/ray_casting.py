"""Where a ray meets a triangle surface."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface


def hits(origin: Float, direction: Float, surface: Surface) -> Float:
    """Distances (k,) mm, ascending, from `origin` (3,) along `direction` (3,) to the facets that
    the ray meets, edges shared by two facets once (Moeller & Trumbore 1997)."""
    d = direction / np.linalg.norm(direction)
    a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
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


def way_out(start: Float, out: Float, body: Surface, most: float) -> tuple[float, float]:
    """From a point in the body along `out`: how far to the skin, and how far a tool may go on, up
    to `most` mm beyond it but only half way to where the body begins again."""
    found = hits(start, out, body)
    inlet = float(found[0]) if len(found) else 0.0
    again = found[found > inlet + 0.1]
    return inlet, inlet + min(most, (again[0] - inlet) / 2 if len(again) else most)
