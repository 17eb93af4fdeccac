"""How far a repair moved the surface."""

from __future__ import annotations

import igl
import numpy as np

from ....core.arrays import Bool, Float, Int
from ....core.mesh import facet_crosses
from .inside import Inside, beside

_MOST = 40_000  # points that are measured, each way
_SAME = 1e-9  # of the size
_NEAR = 1e-3  # of the way from a corner to the other side
# Weights of a triangle's corners.
_FIXED = np.concatenate([np.full((1, 3), 1 / 3), np.eye(3), (1 - np.eye(3)) / 2])


def moved(before: tuple[Float, Int], after: tuple[Float, Int], size: float) -> float:
    """The largest distance from new triangles to the surface before, and from those before that
    are gone to the surface after, mm; of these, what was buried does not count: all but what has
    the outside on just one side, be it turned inside out."""
    new = _points(after, _new(after, before, size))[0]
    points, within, normals = _points(before, _new(before, after, size))
    behind, ahead = (np.abs(w) < 0.5 for w in beside(Inside(*before), within, normals, size))
    seen = behind != ahead
    return max(_farthest(new, before), _farthest(points[seen], after))


def _new(mesh: tuple[Float, Int], other: tuple[Float, Int], size: float) -> Bool:
    """Triangles (m,) that the other does not have."""
    mine, theirs = (np.round(v[f].mean(1) / (_SAME * size)) for v, f in (mesh, other))
    _, index = np.unique(np.concatenate([theirs, mine]), axis=0, return_inverse=True)
    index = index.reshape(-1)
    return np.asarray(~np.isin(index[len(theirs) :], index[: len(theirs)]))


def _points(mesh: tuple[Float, Int], chosen: Bool) -> tuple[Float, Float, Float]:
    """Points (n, 3) of the chosen triangles, as many on each as its area asks for, always its
    corners, the middles of its edges and its centre; beside each a point that is not on an edge;
    and the triangles' normals there."""
    corners = mesh[0][mesh[1][chosen]]
    cross = facet_crosses(mesh[0], mesh[1][chosen])
    area = np.linalg.norm(cross, axis=1)
    corners, cross, area = corners[area > 0], cross[area > 0], area[area > 0]
    if not len(corners):
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3))
    rng = np.random.default_rng(0)
    face = rng.choice(len(area), min(_MOST, 20 * len(area)), p=area / area.sum())
    a, b = np.sqrt(rng.random(len(face))), rng.random(len(face))
    weights = np.concatenate(
        [np.tile(_FIXED, (len(area), 1)), np.stack([1 - a, a * (1 - b), a * b], axis=1)]
    )
    face = np.concatenate([np.repeat(np.arange(len(area)), len(_FIXED)), face])
    step = max(1, len(face) // (2 * _MOST))
    face, weights = face[::step], weights[::step]
    points, within = (
        np.einsum("ni,nij->nj", w, corners[face])
        for w in (weights, (1 - 3 * _NEAR) * weights + _NEAR)
    )
    return points, within, (cross / area[:, None])[face]


def _farthest(points: Float, mesh: tuple[Float, Int]) -> float:
    if not len(points):
        return 0.0
    found = igl.point_mesh_squared_distance(
        np.ascontiguousarray(points), np.ascontiguousarray(mesh[0]), np.ascontiguousarray(mesh[1])
    )[0]
    return float(np.sqrt(np.max(found)))
