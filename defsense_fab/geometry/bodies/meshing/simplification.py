"""Simplify surfaces that have far more triangles than tets of an edge length can represent.

Quadric edge collapse (Garland & Heckbert 1997) that refuses collapses after which the surface would
cross itself. It is sequential, so that it gives the same result everywhere. The distance between
the result and the given surface is measured afterwards, in both directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np

from ....core.arrays import Float, Int
from ....core.mesh import Surface
from ...kernels.surface_queries import signed_distance_of

#: Surfaces with fewer triangles than this are never simplified.
MIN_FINE_TRIANGLES = 20_000
#: Edges of a surface below this share of the tets' edges are finer than tets can represent.
FINE_EDGE_SHARE = 0.25
#: Allowed distance of the simplified surface from the given one, in edges of the tets.
TOLERANCE_EDGES = 0.05
#: Edges that fold by more than this are sharp (cosine), and continue straight up to this turn.
FOLD_COSINE, STRAIGHT_COSINE = np.cos(np.deg2rad(40.0)), -np.cos(np.deg2rad(25.0))
#: Folds from which Netgen takes an edge of a surface for one of the body (cosine).
ROUGH_FOLD_COSINE = np.cos(np.deg2rad(30.0))
#: Folds longer than this share of the body's size need not continue.
LONG_FOLD_SHARE = 0.05
#: Share of the length of folds that continues straight unless they are noise.
STRAIGHT_SHARE = 0.5


@dataclass(frozen=True)
class SimplifiedSurface:
    """A surface to mesh.

    Attributes:
        surface: The surface.
        tolerance: Allowed distance from the given surface, mm; 0 if it is that one.
        deviation: Measured distance, mm.
    """

    surface: Surface
    tolerance: float = 0.0
    deviation: float = 0.0


def is_fine(surface: Surface, edge_length: float) -> bool:
    """Return whether a surface has many triangles, all smaller than the tets, and no sharp edges.

    Scanners and sculpting programs write such surfaces; CAD programs do not.

    Args:
        surface: The surface.
        edge_length: Edge length of the tets, mm.
    """
    if len(surface.faces) <= MIN_FINE_TRIANGLES:
        return False
    corners = surface.vertices[surface.faces]
    longest = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).max()
    return bool(longest < edge_length) and not is_creased(surface)


def _useful_triangles(surface: Surface, edge_length: float) -> int:
    """Return the number of triangles of the finest surface that tets can represent."""
    return int(surface.area / (np.sqrt(3) / 4 * (FINE_EDGE_SHARE * edge_length) ** 2))


def simplify_surface(surface: Surface, edge_length: float) -> SimplifiedSurface:
    """Simplify a surface as far as it stays within `TOLERANCE_EDGES` edges.

    Args:
        surface: The surface.
        edge_length: Edge length of the tets, mm.

    Returns:
        The simplified surface; the given one if it is not fine or no simpler one is near enough.
    """
    if not is_fine(surface, edge_length):
        return SimplifiedSurface(surface)
    tolerance = TOLERANCE_EDGES * edge_length
    count = max(_useful_triangles(surface, edge_length) // 2, 5000)
    while count < 0.7 * len(surface.faces):
        vertices, faces, *_ = igl.qslim(
            np.asfortranarray(surface.vertices),
            np.asfortranarray(surface.faces, np.int32),
            count,
            block_intersections=True,
        )
        simplified = Surface(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64))
        distance = measure_deviation(simplified, surface)
        if distance <= tolerance:
            return SimplifiedSurface(simplified, tolerance, distance)
        count *= 2
    return SimplifiedSurface(surface)


def measure_deviation(a: Surface, b: Surface) -> float:
    """Return the largest distance between two surfaces, mm.

    It is measured from the corners, edge centers and triangle centers of each to the other.
    """
    return float(max(_sample_distances(a, b).max(), _sample_distances(b, a).max()))


def _sample_distances(a: Surface, b: Surface) -> Float:
    corners = a.vertices[a.faces]
    middles = (corners + corners[:, [1, 2, 0]]) / 2
    points = np.concatenate(
        [a.vertices[np.unique(a.faces)], middles.reshape(-1, 3), corners.mean(1)]
    )
    return signed_distance_of(b).unsigned(points)


def is_creased(surface: Surface) -> bool:
    """Return whether a body has sharp edges, which remeshing would cut off.

    These are folds that continue straight and together are longer than the body. Folds of noise and
    bumps do not.
    """
    normals = surface.normals
    a, b, left, right = find_triangle_pairs(surface.faces)
    is_folded = (normals[left] * normals[right]).sum(1) < FOLD_COSINE
    a, b = a[is_folded], b[is_folded]
    along = surface.vertices[b] - surface.vertices[a]
    lengths = np.linalg.norm(along, axis=1)
    along /= np.where(lengths > 0, lengths, 1.0)[:, None]
    ends = np.concatenate([a, b])
    directions = np.concatenate([along, -along])
    count = np.bincount(ends, minlength=len(surface.vertices))
    # The sum of directions away from a vertex vanishes where two folds continue straight.
    total = np.stack([np.bincount(ends, directions[:, k], len(count)) for k in range(3)], axis=1)
    is_straight = (count == 2) & ((total**2).sum(1) <= 2 + 2 * STRAIGHT_COSINE)
    is_broken = (count == 1) | ((count == 2) & ~is_straight)
    size = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    is_sharp = (
        (is_straight[a] | is_straight[b] | (lengths > LONG_FOLD_SHARE * size))
        & ~is_broken[a]
        & ~is_broken[b]
    )
    return bool(lengths[is_sharp].sum() > max(size, STRAIGHT_SHARE * lengths.sum()))


def is_rough(surface: Surface) -> bool:
    """Return whether folds of the skin are together longer than the body.

    Netgen takes each of these for an edge of the body, and places small tets along it.
    """
    normals = surface.normals
    a, b, left, right = find_triangle_pairs(surface.faces)
    is_folded = (normals[left] * normals[right]).sum(1) < ROUGH_FOLD_COSINE
    along = (surface.vertices[b] - surface.vertices[a])[is_folded]
    size = np.linalg.norm(np.ptp(surface.bounds, axis=0))
    return bool(np.linalg.norm(along, axis=1).sum() > size)


def find_triangle_pairs(faces: Int) -> tuple[Int, Int, Int, Int]:
    """Return the edges that two triangles share: both ends, in the order of the first, and the
    triangles.
    """
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = int(faces.max()) + 1
    key = ends.min(1) * count + ends.max(1)
    order = np.argsort(key, kind="stable")
    is_shared = key[order][1:] == key[order][:-1]
    first, second = order[:-1][is_shared], order[1:][is_shared]
    return ends[first, 0], ends[first, 1], first // 3, second // 3
