"""Surfaces with far more triangles than tets of an edge length can show, simplified before meshing.

Quadric edge collapse (Garland & Heckbert 1997) that refuses collapses after which the surface would
cut itself. It is sequential, so that it gives the same everywhere. How far the result is from what
was given is measured afterwards, from both sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np

from ....core.arrays import Float, Int
from ....core.mesh import Surface, facet_crosses

#: Surfaces with fewer triangles than this are never simplified.
FEW = 20_000
#: Edges of a surface shorter than this share of the tets' edges are more than these show.
_FINE = 0.25
#: How far the simplified surface may be from the one given, in edges of the tets.
TOLERANCE = 0.05
#: Edges that fold by more than this are sharp (cosine), and go on straight up to this turn.
_FOLD, _STRAIGHT = np.cos(np.deg2rad(40.0)), -np.cos(np.deg2rad(25.0))
#: Folds longer than this share of the body's size need not go on.
_LONG = 0.05
#: Of all that folds, this share goes on straight where it is not noise.
_MOSTLY = 0.5


@dataclass(frozen=True)
class Simplified:
    """The `surface` to mesh; how far it may be from the one given and how far it is, mm: both are 0
    where it is that one."""

    surface: Surface
    tolerance: float = 0.0
    deviation: float = 0.0


def area(surface: Surface) -> float:
    """mm^2."""
    crosses = facet_crosses(surface.vertices, surface.faces)
    return float(np.linalg.norm(crosses, axis=1).sum() / 2)


def is_fine(surface: Surface, edge_length: float) -> bool:
    """Whether the surface has many triangles, all smaller than tets of an edge length (mm), and no
    sharp edges: as scanners and sculpting programs write them, and CAD programs do not."""
    if len(surface.faces) <= FEW:
        return False
    corners = surface.vertices[surface.faces]
    longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max()
    return bool(longest < edge_length) and not is_creased(surface)


def _shown(surface: Surface, edge_length: float) -> int:
    """How many triangles the finest surface has that is worth its while."""
    return int(area(surface) / (np.sqrt(3) / 4 * (_FINE * edge_length) ** 2))


def simplified(surface: Surface, edge_length: float) -> Simplified:
    """The surface with as few triangles as keep it within TOLERANCE edges; itself where no simpler
    one is as near, or where it has few or is not fine."""
    if not is_fine(surface, edge_length):
        return Simplified(surface)
    tolerance = TOLERANCE * edge_length
    count = max(_shown(surface, edge_length) // 2, 5000)
    while count < 0.7 * len(surface.faces):
        vertices, faces, *_ = igl.qslim(
            np.asfortranarray(surface.vertices),
            np.asfortranarray(surface.faces, np.int32),
            count,
            block_intersections=True,
        )
        made = Surface(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64))
        off = deviation(made, surface)
        if off <= tolerance:
            return Simplified(made, tolerance, off)
        count *= 2
    return Simplified(surface)


def deviation(a: Surface, b: Surface) -> float:
    """The largest distance (mm) between two surfaces: from the corners, the middles of edges and
    the middles of triangles of each to the other."""
    return float(max(_distances(a, b).max(), _distances(b, a).max()))


def _distances(a: Surface, b: Surface) -> Float:
    corners = a.vertices[a.faces]
    middles = (corners + corners[:, [1, 2, 0]]) / 2
    points = np.concatenate(
        [a.vertices[np.unique(a.faces)], middles.reshape(-1, 3), corners.mean(1)]
    )
    squared = igl.point_mesh_squared_distance(
        points, np.ascontiguousarray(b.vertices), np.ascontiguousarray(b.faces)
    )[0]
    return np.asarray(np.sqrt(squared))


def is_creased(surface: Surface) -> bool:
    """Whether the body has sharp edges, which triangles laid afresh would cut off: folds that go on
    straight, and are longer, together, than the body. Those of noise and bumps do not."""
    cross = facet_crosses(surface.vertices, surface.faces)
    length = np.linalg.norm(cross, axis=1)
    normals = cross / np.where(length > 0, length, 1.0)[:, None]
    a, b, left, right = pairs(surface.faces)
    folded = (normals[left] * normals[right]).sum(1) < _FOLD
    a, b = a[folded], b[folded]
    along = surface.vertices[b] - surface.vertices[a]
    long = np.linalg.norm(along, axis=1)
    along /= np.where(long > 0, long, 1.0)[:, None]
    ends = np.concatenate([a, b])
    out = np.concatenate([along, -along])
    count = np.bincount(ends, minlength=len(surface.vertices))
    # Of the directions away from a vertex: none where two folds go on straight.
    total = np.stack([np.bincount(ends, out[:, k], len(count)) for k in range(3)], axis=1)
    straight = (count == 2) & ((total**2).sum(1) <= 2 + 2 * _STRAIGHT)
    broken = (count == 1) | ((count == 2) & ~straight)
    size = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    sharp = (straight[a] | straight[b] | (long > _LONG * size)) & ~broken[a] & ~broken[b]
    return bool(long[sharp].sum() > max(size, _MOSTLY * long.sum()))


def pairs(faces: Int) -> tuple[Int, Int, Int, Int]:
    """Edges that two triangles share: their ends, in the order of the first, and the triangles."""
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = int(faces.max()) + 1
    key = ends.min(1) * count + ends.max(1)
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    first, second = order[:-1][same], order[1:][same]
    return ends[first, 0], ends[first, 1], first // 3, second // 3
