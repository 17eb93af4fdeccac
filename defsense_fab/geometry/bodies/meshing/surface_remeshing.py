"""Triangles laid afresh over a surface: as long as the tets' edges, shorter where it is curved.

The vertices are lifted into six dimensions by their normals, times a length (Levy & Bonneel 2012):
there, triangles of one size are small where the normals turn. The shortest edges are collapsed
until as many triangles are left as that size gives; then edges are flipped and vertices moved along
the surface, onto which they are put back.
"""

from __future__ import annotations

import igl
import numpy as np
from scipy.sparse import csr_matrix

from ....core.arrays import Float, Int
from ....core.errors import MeshingError
from ....core.mesh import Surface, facet_crosses
from ...kernels.surface_queries import signed_distance_of
from .simplification import pairs

# A surface from a grid of signed distances: what is left of one that cannot be meshed as it is.
#
# Winding numbers (Barill et al. 2018) tell inside from outside also where a surface crosses itself
# or has holes. Whatever is finer than the grid is lost, and gaps narrower than it are closed.

#: The grid's step, in edges of the tets, and how many points it has at most.
_STEP, _MOST = 0.4, 1_500_000


def voxel_surface(surface: Surface, edge_length: float) -> Surface:
    """The largest closed piece of the surface at distance 0 on a grid, by marching cubes. Raises
    MeshingError where there is none."""
    low, high = surface.bounds
    step = _step(surface, edge_length)
    axes = [np.arange(a - 2 * step, b + 3 * step, step) for a, b in zip(low, high, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    inside = igl.fast_winding_number(
        surface.vertices, np.ascontiguousarray(surface.faces), points
    ) > 0.5  # fmt: skip
    squared = igl.point_mesh_squared_distance(
        points, surface.vertices, np.ascontiguousarray(surface.faces)
    )[0]
    signed = np.where(inside, -1.0, 1.0) * np.sqrt(np.asarray(squared))
    signed = np.where(np.abs(signed) < 0.05 * step, 0.05 * step, signed)  # no slivers
    vertices, faces, _ = igl.marching_cubes(signed, points, *(len(a) for a in axes), 0.0)
    if not len(faces):
        raise MeshingError(f"a grid of {step:.2g} mm holds nothing of the body", code="grid-empty")
    faces = np.asarray(faces, np.int64)
    piece = np.asarray(igl.facet_components(faces)[1])
    faces = faces[piece == np.bincount(piece).argmax()]
    made = Surface(np.asarray(vertices, float), faces).compact()[0]
    return made if made.volume > 0 else Surface(made.vertices, made.faces[:, ::-1].copy())


def grid_points(surface: Surface, edge_length: float) -> float:
    """About how many points that grid has."""
    return float(np.prod(np.ptp(surface.bounds, axis=0) / _step(surface, edge_length) + 4))


def _step(surface: Surface, edge_length: float) -> float:
    whole = float(np.prod(np.ptp(surface.bounds, axis=0)))
    return max(_STEP * edge_length, float(np.cbrt(whole / _MOST)))


#: Edges in six dimensions, and the length that normals are multiplied with, in edges of the tets.
_EDGE, _CURVED = 0.85, 1.0
#: Normals are taken over this many edges of the tets.
_SMOOTH = 0.25
#: Edges are split until none is longer than this many edges of the tets.
_SPLIT = 0.6
_ROUNDS = 8
#: What a triangle may turn by when a vertex moves or an edge is flipped (cosine).
_TURN = 0.7
#: Edges that fold by more than this (cosine) stay, and so do their ends.
_FOLD = np.cos(np.deg2rad(60.0))


def remeshed(surface: Surface, edge_length: float) -> Surface:
    """A surface of triangles with edges of `edge_length` mm or less whose vertices lie on the one
    given. Raises MeshingError where there is none."""
    vertices, faces = _split(surface.vertices, surface.faces, _SPLIT * edge_length)
    lifted = np.hstack([vertices, _CURVED * edge_length * _normals(vertices, faces, edge_length)])
    count = max(int(_area(lifted, faces) / (np.sqrt(3) / 4 * (_EDGE * edge_length) ** 2)), 20)
    if count < len(faces):
        made, faces, *_ = igl.decimate(
            np.asfortranarray(lifted), np.asfortranarray(faces, np.int32), count
        )
        faces = np.ascontiguousarray(faces, np.int64)
        vertices = np.ascontiguousarray(made[:, :3])
    vertices = signed_distance_of(surface).nearest(vertices)
    for _ in range(_ROUNDS):
        faces = _flipped(vertices, faces)
        vertices = _moved(vertices, faces, surface)
    out = Surface(vertices, faces)
    if not out.volume > 0:
        raise MeshingError("triangles of that size enclose no volume", code="encloses-no-volume")
    return out


def _area(x: Float, faces: Int) -> float:
    """Of triangles in any number of dimensions."""
    a, b = x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]
    squared = (a**2).sum(1) * (b**2).sum(1) - (a * b).sum(1) ** 2
    return float(np.sqrt(np.maximum(squared, 0)).sum() / 2)


def _unit(x: Float) -> Float:
    length = np.linalg.norm(x, axis=1, keepdims=True)
    return np.asarray(x / np.where(length > 0, length, 1.0))


def _at_vertices(values: Float, faces: Int, count: int) -> Float:
    """Sums (count, 3) of what the triangles at each vertex have (m, 3)."""
    return np.stack(
        [np.bincount(faces.ravel(), np.repeat(values[:, k], 3), count) for k in range(3)], axis=1
    )


def _normals(vertices: Float, faces: Int, edge_length: float) -> Float:
    """At the vertices, smoothed so that what is finer than the tets does not count."""
    normals = _unit(_at_vertices(facet_crosses(vertices, faces), faces, len(vertices)))
    a, b = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0).T
    edges = np.linalg.norm(vertices[a] - vertices[b], axis=1).mean()
    own = np.arange(len(vertices))
    i, j = np.concatenate([a, b, own]), np.concatenate([b, a, own])
    around = csr_matrix((np.ones(len(i)), (i, j)))
    for _ in range(int(np.clip(2 * (_SMOOTH * edge_length / edges) ** 2, 1, 100))):
        normals = _unit(around @ normals)
    return normals


def _split(vertices: Float, faces: Int, longest: float) -> tuple[Float, Int]:
    """With edges halved until none is longer."""
    for _ in range(30):
        ends = faces[:, [[0, 1], [1, 2], [2, 0]]]
        long = np.linalg.norm(vertices[ends[..., 0]] - vertices[ends[..., 1]], axis=2)
        # One edge of a triangle at a time, the longest: two halves, and no new shape to choose.
        marked = np.zeros(long.shape, bool)
        rows = np.arange(len(faces))
        marked[rows, long.argmax(1)] = long.max(1) > longest
        if not marked.any():
            break
        key = ends.min(2) * len(vertices) + ends.max(2)
        chosen = np.unique(key[marked])
        # A triangle of which two edges are wanted gets the longer one now, the other one later.
        wanted = np.isin(key, chosen)
        best = np.where(wanted, long, -1.0).argmax(1)
        agreed = np.zeros_like(wanted)
        agreed[rows, best] = wanted[rows, best]
        both = np.unique(key[agreed], return_counts=True)
        chosen = both[0][both[1] == 2]
        hit = agreed & np.isin(key, chosen)
        row, side = np.nonzero(hit)
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


def _flipped(vertices: Float, faces: Int) -> Int:
    """With edges flipped where the two angles across exceed a half turn (Delaunay)."""
    a, b, left, right = pairs(faces)
    c = faces[left].sum(1) - a - b
    d = faces[right].sum(1) - a - b

    def angle(at: Int) -> Float:
        u, v = _unit(vertices[a] - vertices[at]), _unit(vertices[b] - vertices[at])
        return np.asarray(np.arccos(np.clip((u * v).sum(1), -1, 1)))

    excess = angle(c) + angle(d) - np.pi
    n = _unit(facet_crosses(vertices, faces))
    first, second = np.column_stack([a, d, c]), np.column_stack([d, b, c])
    p, q = (_unit(facet_crosses(vertices, f)) for f in (first, second))
    old = n[left] + n[right]
    fine = (n[left] * n[right]).sum(1) > _FOLD
    fine &= ((p * q).sum(1) > _TURN) & ((p * _unit(old)).sum(1) > _TURN)
    fine &= (q * _unit(old)).sum(1) > _TURN
    candidates = np.flatnonzero(fine & (excess > 1e-3))
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


def _moved(vertices: Float, faces: Int, surface: Surface) -> Float:
    """With vertices moved along the surface towards the middle of the triangles at them."""
    cross = facet_crosses(vertices, faces)
    size = np.linalg.norm(cross, axis=1, keepdims=True)
    count = len(vertices)
    total = _at_vertices(np.repeat(size, 3, axis=1), faces, count)
    middle = _at_vertices(size * vertices[faces].mean(1), faces, count) / np.maximum(total, 1e-300)
    normals = _unit(_at_vertices(cross, faces, count))
    step = 0.6 * (middle - vertices)
    step -= (step * normals).sum(1, keepdims=True) * normals
    unit = _unit(cross)
    a, b, left, right = pairs(faces)
    sharp = (unit[left] * unit[right]).sum(1) < _FOLD
    step[np.concatenate([a[sharp], b[sharp]])] = 0.0
    target = signed_distance_of(surface).nearest(vertices + step)
    target[(step == 0).all(1)] = vertices[(step == 0).all(1)]
    for _ in range(8):
        turned = (_unit(facet_crosses(target, faces)) * unit).sum(1) < _TURN
        if not turned.any():
            return target
        back = np.unique(faces[turned])
        target[back] = vertices[back]
    return vertices
