"""Remesh a surface: triangles as long as the tets' edges, shorter where the surface is curved.

The vertices are lifted into six dimensions by their normals, times a length (Levy & Bonneel 2012):
there, triangles of one size are small where the normals turn. The shortest edges are collapsed
until as many triangles are left as that size gives; then edges are flipped and vertices moved along
the surface, onto which they are projected. A surface that cannot be meshed as it is is rebuilt from
a grid of signed distances instead. Large surfaces are remeshed, or simplified, in a child process:
`python -m` this module.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import igl
import numpy as np
from scipy.sparse import csr_matrix

from ....core.arrays import Float, Int
from ....core.errors import MeshingError
from ....core.mesh import Surface, facet_crosses, triangle_edges
from ...kernels.surface_queries import signed_distance_of
from ..repair.crossings import find_crossing_pairs
from .child_work import RunMonitor, run_work, serve_work
from .simplification import (
    MIN_FINE_TRIANGLES,
    SimplifiedSurface,
    find_triangle_pairs,
    simplify_surface,
)

#: Step of the grid in edges of the tets, and its largest number of points.
GRID_STEP_EDGES, MAX_GRID_POINTS = 0.4, 1_500_000


def remesh_on_grid(surface: Surface, edge_length: float) -> Surface:
    """Rebuild a surface from a grid of signed distances by marching cubes.

    Winding numbers (Barill et al. 2018) separate inside from outside even if the surface crosses
    itself or has holes. Details finer than the grid are lost, and narrower gaps are closed.

    Args:
        surface: The surface, mm.
        edge_length: Edge length of the tets, mm.

    Returns:
        The largest closed piece of the surface at distance 0.

    Raises:
        MeshingError: If there is none.
    """
    low, high = surface.bounds
    step = _grid_step(surface, edge_length)
    axes = [np.arange(a - 2 * step, b + 3 * step, step) for a, b in zip(low, high, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    distances = signed_distance_of(surface)
    signed = np.where(distances.inside(points), -1.0, 1.0) * distances.unsigned(points)
    signed = np.where(np.abs(signed) < 0.05 * step, 0.05 * step, signed)  # no slivers
    vertices, faces, _ = igl.marching_cubes(signed, points, *(len(a) for a in axes), 0.0)
    if not len(faces):
        raise MeshingError(
            f"a grid of {step:.2g} mm contains nothing of the body", code="grid-empty"
        )
    faces = np.asarray(faces, np.int64)
    piece = np.asarray(igl.facet_components(faces)[1])
    faces = faces[piece == np.bincount(piece).argmax()]
    result = Surface(np.asarray(vertices, float), faces).compact()[0]
    return result if result.volume > 0 else Surface(result.vertices, result.faces[:, ::-1].copy())


def count_grid_points(surface: Surface, edge_length: float) -> float:
    """Return about how many points the grid of `remesh_on_grid` has."""
    return float(np.prod(np.ptp(surface.bounds, axis=0) / _grid_step(surface, edge_length) + 4))


def _grid_step(surface: Surface, edge_length: float) -> float:
    whole = float(np.prod(np.ptp(surface.bounds, axis=0)))
    return max(GRID_STEP_EDGES * edge_length, float(np.cbrt(whole / MAX_GRID_POINTS)))


#: Edges in six dimensions, and the factor on normals, in edges of the tets.
LIFTED_EDGE, NORMAL_WEIGHT = 0.85, 1.0
#: Normals are smoothed over this many edges of the tets.
SMOOTHING_EDGES = 0.25
#: Edges are split until none is longer than this many edges of the tets.
MAX_SPLIT_EDGE = 0.6
ROUNDS = 8
#: Largest turn of a triangle when a vertex moves or an edge is flipped (cosine).
MIN_TURN_COSINE = 0.7
#: Edges that fold by more than this (cosine) stay, and so do their ends.
FOLD_COSINE = np.cos(np.deg2rad(60.0))


#: Shares of the edge length that are tried until no triangles cross each other.
EDGE_SHARES = (1.0, 0.95, 0.9, 0.85)


def remesh_surface(surface: Surface, edge_length: float) -> Surface:
    """Remesh a surface with edges of `edge_length` mm or less and vertices on the given surface.

    Raises:
        MeshingError: If the result encloses no volume, or its triangles cross each other.
    """
    for share in EDGE_SHARES:
        remeshed = _remesh(surface, share * edge_length)
        if not len(find_crossing_pairs(remeshed.vertices, remeshed.faces)):
            return remeshed
    raise MeshingError("triangles of that size cross each other", code="surface-crosses-itself")


def _remesh(surface: Surface, edge_length: float) -> Surface:
    vertices, faces = _split_edges(surface.vertices, surface.faces, MAX_SPLIT_EDGE * edge_length)
    lifted = np.hstack(
        [vertices, NORMAL_WEIGHT * edge_length * _smooth_normals(vertices, faces, edge_length)]
    )
    count = max(int(_area(lifted, faces) / (np.sqrt(3) / 4 * (LIFTED_EDGE * edge_length) ** 2)), 20)
    if count < len(faces):
        collapsed, faces, *_ = igl.decimate(
            np.asfortranarray(lifted), np.asfortranarray(faces, np.int32), count
        )
        faces = np.ascontiguousarray(faces, np.int64)
        vertices = np.ascontiguousarray(collapsed[:, :3])
    vertices = signed_distance_of(surface).nearest(vertices)
    for _ in range(ROUNDS):
        faces = _flip_edges(vertices, faces)
        vertices = _relax_vertices(vertices, faces, surface)
    out = Surface(vertices, faces)
    if not out.volume > 0:
        raise MeshingError("triangles of that size enclose no volume", code="encloses-no-volume")
    return out


def _area(x: Float, faces: Int) -> float:
    """Return the area of triangles in any number of dimensions."""
    a, b = x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]
    squared = (a**2).sum(1) * (b**2).sum(1) - (a * b).sum(1) ** 2
    return float(np.sqrt(np.maximum(squared, 0)).sum() / 2)


def _unit(x: Float) -> Float:
    length = np.linalg.norm(x, axis=1, keepdims=True)
    return np.asarray(x / np.where(length > 0, length, 1.0))


def _sum_at_vertices(values: Float, faces: Int, count: int) -> Float:
    """Return the sums (count, 3) over the triangles at each vertex of their values (m, 3)."""
    return np.stack(
        [np.bincount(faces.ravel(), np.repeat(values[:, k], 3), count) for k in range(3)], axis=1
    )


def _smooth_normals(vertices: Float, faces: Int, edge_length: float) -> Float:
    """Return normals at the vertices, smoothed so that details finer than the tets do not count."""
    normals = _unit(_sum_at_vertices(facet_crosses(vertices, faces), faces, len(vertices)))
    a, b = triangle_edges(faces)[0].T
    edges = np.linalg.norm(vertices[a] - vertices[b], axis=1).mean()
    itself = np.arange(len(vertices))
    i, j = np.concatenate([a, b, itself]), np.concatenate([b, a, itself])
    around = csr_matrix((np.ones(len(i)), (i, j)))
    for _ in range(int(np.clip(2 * (SMOOTHING_EDGES * edge_length / edges) ** 2, 1, 100))):
        normals = _unit(around @ normals)
    return normals


def _split_edges(vertices: Float, faces: Int, max_length: float) -> tuple[Float, Int]:
    """Halve edges until none is longer than `max_length` mm."""
    for _ in range(30):
        ends = faces[:, [[0, 1], [1, 2], [2, 0]]]
        lengths = np.linalg.norm(vertices[ends[..., 0]] - vertices[ends[..., 1]], axis=2)
        # Split one edge of a triangle at a time, the longest, so that the split is unique.
        marked = np.zeros(lengths.shape, bool)
        rows = np.arange(len(faces))
        marked[rows, lengths.argmax(1)] = lengths.max(1) > max_length
        if not marked.any():
            break
        key = ends.min(2) * len(vertices) + ends.max(2)
        chosen = np.unique(key[marked])
        # If two edges of a triangle are requested, it is split at the longer one first.
        is_requested = np.isin(key, chosen)
        best = np.where(is_requested, lengths, -1.0).argmax(1)
        is_chosen = np.zeros_like(is_requested)
        is_chosen[rows, best] = is_requested[rows, best]
        counts = np.unique(key[is_chosen], return_counts=True)
        chosen = counts[0][counts[1] == 2]
        is_split = is_chosen & np.isin(key, chosen)
        row, side = np.nonzero(is_split)
        if not len(row):
            break
        new = len(vertices) + np.searchsorted(chosen, key[row, side])
        low, high = chosen // len(vertices), chosen % len(vertices)
        middle = (vertices[low] + vertices[high]) / 2
        a, b, c = (faces[row, (side + k) % 3] for k in range(3))
        vertices = np.concatenate([vertices, middle])
        faces = faces.copy()
        faces[row] = np.column_stack([a, new, c])
        faces = np.concatenate([faces, np.column_stack([new, b, c])])
    return vertices, faces


def _flip_edges(vertices: Float, faces: Int) -> Int:
    """Flip edges where the two opposite angles exceed a half turn (Delaunay)."""
    a, b, left, right = find_triangle_pairs(faces)
    c = faces[left].sum(1) - a - b
    d = faces[right].sum(1) - a - b

    def angle(at: Int) -> Float:
        u, v = _unit(vertices[a] - vertices[at]), _unit(vertices[b] - vertices[at])
        return np.asarray(np.arccos(np.clip((u * v).sum(1), -1, 1)))

    excess = angle(c) + angle(d) - np.pi
    n = _unit(facet_crosses(vertices, faces))
    first, second = np.column_stack([a, d, c]), np.column_stack([d, b, c])
    p, q = (_unit(facet_crosses(vertices, f)) for f in (first, second))
    mean_normal = n[left] + n[right]
    is_allowed = (n[left] * n[right]).sum(1) > FOLD_COSINE
    is_allowed &= ((p * q).sum(1) > MIN_TURN_COSINE) & (
        (p * _unit(mean_normal)).sum(1) > MIN_TURN_COSINE
    )
    is_allowed &= (q * _unit(mean_normal)).sum(1) > MIN_TURN_COSINE
    candidates = np.flatnonzero(is_allowed & (excess > 1e-3))
    edges = set(zip(np.minimum(a, b).tolist(), np.maximum(a, b).tolist(), strict=True))
    touched: set[int] = set()
    faces = faces.copy()
    for k in candidates[np.argsort(-excess[candidates], kind="stable")].tolist():
        f, g = int(left[k]), int(right[k])
        new = (min(int(c[k]), int(d[k])), max(int(c[k]), int(d[k])))
        if f in touched or g in touched or new in edges or new[0] == new[1]:
            continue
        touched |= {f, g}
        edges.add(new)
        faces[f], faces[g] = first[k], second[k]
    return faces


def _relax_vertices(vertices: Float, faces: Int, surface: Surface) -> Float:
    """Move vertices along the surface towards the center of the triangles at them."""
    cross = facet_crosses(vertices, faces)
    size = np.linalg.norm(cross, axis=1, keepdims=True)
    count = len(vertices)
    total = _sum_at_vertices(np.repeat(size, 3, axis=1), faces, count)
    middle = _sum_at_vertices(size * vertices[faces].mean(1), faces, count) / np.maximum(
        total, 1e-300
    )
    normals = _unit(_sum_at_vertices(cross, faces, count))
    step = 0.6 * (middle - vertices)
    step -= (step * normals).sum(1, keepdims=True) * normals
    unit = _unit(cross)
    a, b, left, right = find_triangle_pairs(faces)
    is_sharp = (unit[left] * unit[right]).sum(1) < FOLD_COSINE
    step[np.concatenate([a[is_sharp], b[is_sharp]])] = 0.0
    target = signed_distance_of(surface).nearest(vertices + step)
    target[(step == 0).all(1)] = vertices[(step == 0).all(1)]
    for _ in range(8):
        is_turned = (_unit(facet_crosses(target, faces)) * unit).sum(1) < MIN_TURN_COSINE
        if not is_turned.any():
            return target
        restored = np.unique(faces[is_turned])
        target[restored] = vertices[restored]
    return vertices


#: Kinds of work of a child process, as named in messages.
SIMPLIFY = "simplifying the surface"
REMESH = "remeshing the surface"
GRID = "building a grid of distances"
#: Larger grids take long: each point takes a winding number and a distance.
MAX_QUICK_POINTS = 200_000


def simplify_in_time(
    surface: Surface, edge_length: float, monitor: RunMonitor
) -> SimplifiedSurface:
    """Return the result of `simplify_surface` of a fine surface.

    Raises:
        MeshingError: If it takes longer than the monitor allows.
    """
    simplified = _run(SIMPLIFY, surface, edge_length, monitor)
    is_unchanged = len(simplified.surface.faces) == len(surface.faces)
    return SimplifiedSurface(surface) if is_unchanged else simplified


def remesh_in_time(surface: Surface, edge_length: float, monitor: RunMonitor) -> Surface:
    """Return the result of `remesh_surface`.

    Raises:
        MeshingError: As `remesh_surface`, or if it takes longer than the monitor allows.
    """
    if len(surface.faces) <= MIN_FINE_TRIANGLES:
        return remesh_surface(surface, edge_length)
    return _run(REMESH, surface, edge_length, monitor).surface


def remesh_on_grid_in_time(surface: Surface, edge_length: float, monitor: RunMonitor) -> Surface:
    """Return the result of `remesh_on_grid`.

    Raises:
        MeshingError: As `remesh_on_grid`, or if it takes longer than the monitor allows.
    """
    if (
        len(surface.faces) <= MIN_FINE_TRIANGLES
        and count_grid_points(surface, edge_length) <= MAX_QUICK_POINTS
    ):
        return remesh_on_grid(surface, edge_length)
    return _run(GRID, surface, edge_length, monitor).surface


def _run(work: str, surface: Surface, edge_length: float, monitor: RunMonitor) -> SimplifiedSurface:
    task = {"work": work, "edge_length": edge_length}
    arrays = {"vertices": surface.vertices, "faces": surface.faces}
    result = run_work(f"{__package__}.surface_remeshing", work, task | arrays, monitor)
    return SimplifiedSurface(
        Surface(result["vertices"], result["faces"]),
        float(result["tolerance"]),
        float(result["deviation"]),
    )


_WORK: dict[str, Callable[[Surface, float], SimplifiedSurface]] = {
    SIMPLIFY: simplify_surface,
    REMESH: lambda s, edge: SimplifiedSurface(remesh_surface(s, edge)),
    GRID: lambda s, edge: SimplifiedSurface(remesh_on_grid(s, edge)),
}


def _do_work(task: dict[str, Any]) -> dict[str, Any]:
    """Return the result of one kind of work, in a child process."""
    surface = Surface(task["vertices"], task["faces"])
    simplified = _WORK[str(task["work"])](surface, float(task["edge_length"]))
    return {
        "vertices": simplified.surface.vertices,
        "faces": simplified.surface.faces,
        "tolerance": simplified.tolerance,
        "deviation": simplified.deviation,
    }


if __name__ == "__main__":
    serve_work(sys.argv[1], _do_work)
