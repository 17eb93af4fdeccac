"""Organic bodies with the usual defects of meshes, each with the intended body.

Repaired bodies are measured by methods that the repair does not use.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Defective:
    """A defective body of about 100 mm.

    Attributes:
        vertices: Vertices (n, 3) mm.
        faces: Triangles (m, 3).
        volume: Volume of the intended body, mm3.
        meant: Vertices and triangles of the intended body; None if only the volume is known.
    """

    vertices: np.ndarray
    faces: np.ndarray
    volume: float
    meant: tuple[np.ndarray, np.ndarray] | None = None


def _sphere(detail: int) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=detail, radius=1.0)
    return np.array(ball.vertices, float), np.array(ball.faces, np.int64)


def creature(detail: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a head with two ears and a nose, made from a sphere."""
    v, f = _sphere(detail)
    out = np.ones(len(v))
    for way, height, width in (((0.6, 0, 0.8), 0.7, 0.35), ((-0.6, 0, 0.8), 0.7, 0.35),
                               ((0, 1, 0), 0.4, 0.3), ((0, -0.2, -1), 0.3, 0.6)):  # fmt: skip
        d = np.asarray(way) / np.linalg.norm(way)
        out += height * np.exp(-(((v - d) ** 2).sum(1)) / width**2)
    out += 0.03 * np.sin(9 * v[:, 0]) * np.sin(8 * v[:, 1]) * np.sin(7 * v[:, 2])
    return 35 * v * out[:, None], f


def volume_of(v: np.ndarray, f: np.ndarray) -> float:
    """Return the volume of a closed surface, mm3."""
    a, b, c = (v[f[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def _ring(f: np.ndarray, vertex: int, times: int = 1) -> np.ndarray:
    """Return the triangles around a vertex."""
    own = np.array([vertex])
    for _ in range(times):
        own = np.unique(f[np.isin(f, own).any(1)])
    return np.nonzero(np.isin(f, own).all(1))[0]


def crossings(detail: int, seed: int) -> Defective:
    """Drag single vertices sideways, over neighboring triangles."""
    v, f = creature(detail)
    clean, rng = v.copy(), np.random.default_rng(seed)
    for k in rng.choice(len(v), 3, replace=False):
        ring = np.setdiff1d(f[_ring(f, k)], [k])
        other = clean[rng.choice(ring)]
        v[k] = clean[k] + 1.8 * (other - clean[k])
    return Defective(v, f, volume_of(clean, f), (clean, f))


def folds(detail: int, seed: int) -> Defective:
    """Exchange neighboring vertices."""
    v, f = creature(detail)
    clean, rng = v.copy(), np.random.default_rng(seed)
    for row in f[rng.choice(len(f), 5, replace=False)]:
        v[row[:2]] = v[row[1::-1]]
    return Defective(v, f, volume_of(clean, f), (clean, f))


def open_edges(detail: int, seed: int) -> Defective:
    """Open the surface.

    Triangles and patches are missing, two holes meet, some edges have a vertex on one side only,
    some triangles are reversed, and no vertices are shared.
    """
    v, f = creature(detail)
    clean, rng = (v.copy(), f.copy()), np.random.default_rng(seed)
    keep = np.ones(len(f), bool)
    for k in rng.choice(len(v), 4, replace=False):
        keep[np.isin(f, k).any(1)] = False
    corner = _ring(f, int(rng.integers(len(v))))
    keep[corner[[0, len(corner) // 2]]] = False
    f = f[keep]
    split = f[rng.choice(len(f), 6, replace=False)]
    middle = (v[split[:, 0]] + v[split[:, 1]]) / 2
    new = len(v) + np.arange(6)
    rest = f[~(f[:, None] == split[None]).all(2).any(1)]
    f = np.concatenate([rest, np.stack([split[:, 0], new, split[:, 2]], 1),
                        np.stack([new, split[:, 1], split[:, 2]], 1)])  # fmt: skip
    v = np.concatenate([v, middle])
    turn = rng.random(len(f)) < 0.3
    f[turn] = f[turn][:, ::-1]
    return Defective(v[f].reshape(-1, 3), np.arange(3 * len(f)).reshape(-1, 3),
                     volume_of(*clean), clean)  # fmt: skip


def slivers(detail: int, seed: int) -> Defective:
    """Add needles and caps: triangles without height, duplicates, repeated corners."""
    v, f = creature(detail)
    clean, rng = (v.copy(), f.copy()), np.random.default_rng(seed)
    chosen = f[rng.choice(len(f), 20, replace=False)]
    new, rows = [], []
    for k, (a, b, c) in enumerate(chosen):  # a vertex all but on the edge a, b
        new.append(v[a] + 0.4 * (v[b] - v[a]) + 1e-7 * (v[c] - v[a]))
        n = len(v) + k
        rows += [(a, b, n), (b, c, n), (c, a, n)]
    rest = f[~(f[:, None] == chosen[None]).all(2).any(1)]
    f = np.concatenate([rest, np.array(rows), rest[:9], rest[:3][:, [0, 0, 1]]])
    return Defective(np.concatenate([v, new]), f, volume_of(*clean), clean)


def _torus(big: float, small: float, detail: int) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    n = 6 * 2**detail // 4
    ring = trimesh.creation.torus(big, small, major_sections=2 * n, minor_sections=n)
    return np.array(ring.vertices, float), np.array(ring.faces, np.int64)


def genus(detail: int, seed: int) -> Defective:
    """Return four rings and a ball that overlap, as separate shells."""
    rng = np.random.default_rng(seed)
    ball, f = _sphere(detail)
    meshes = [(30 * ball, f)]
    solids: list[Callable[[np.ndarray], np.ndarray]] = [lambda p: (p**2).sum(1) < 900]
    for k in range(4):
        angle = k * np.pi / 2 + 0.1 * rng.random()
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0],
                         [0, 0, 1.0]])  # fmt: skip
        v, g = _torus(14, 5, detail)
        meshes.append(((v + np.array([36.0, 0, 0])) @ turn.T, g))

        def ring(p: np.ndarray, turn: np.ndarray = turn) -> np.ndarray:
            q = p @ turn - np.array([36.0, 0, 0])
            return (np.hypot(q[:, 0], q[:, 1]) - 14) ** 2 + q[:, 2] ** 2 < 25

        solids.append(ring)
    n = 140
    wide, high = np.linspace(-56, 56, n), np.linspace(-31, 31, n)
    grid = np.stack(np.meshgrid(wide, wide, high, indexing="ij"), -1).reshape(-1, 3)
    cell = (112 / (n - 1)) ** 2 * (62 / (n - 1))
    volume = sum(
        np.any([s(part) for s in solids], axis=0).sum() for part in np.array_split(grid, 40)
    )
    return Defective(*_joined(meshes), float(volume * cell))


def inner_shells(detail: int, seed: int) -> Defective:
    """Add a cavity, a solid within the solid, and crumbs."""
    v, f = creature(detail)
    rng = np.random.default_rng(seed)
    ball, g = _sphere(2)
    meshes = [(v, f), (6 * ball + [8, 0, 0], g[:, ::-1]), (4 * ball - [9, 0, 0], g)]
    meshes += [(0.5 * ball + 45 + 30 * rng.random(3), g) for _ in range(3)]
    return Defective(*_joined(meshes), volume_of(v, f), (v, f))


def non_manifold(detail: int, seed: int) -> Defective:
    """Add fins, an inner wall, a corner of two sheets, and an edge with four triangles."""
    v, f = creature(detail)
    clean, rng = (v.copy(), f.copy()), np.random.default_rng(seed)
    tips, rows = [], []
    for k, (a, b, _c) in enumerate(f[rng.choice(len(f), 4, replace=False)]):
        tips.append(1.2 * (v[a] + v[b]) / 2)
        rows.append((a, b, len(v) + k))
    v = np.concatenate([v, tips])
    f = np.concatenate([f, rows])
    # A small pyramid on two triangles' common edge, and one on a corner.
    centers = np.argsort(-clean[0][:, 2])[[len(clean[0]) // 2, len(clean[0]) // 3]]
    a, b = centers[0], np.setdiff1d(clean[1][_ring(clean[1], centers[0])], centers[0])[0]
    out = (v[a] + v[b]) / 2
    out = out / np.linalg.norm(out)
    side = np.cross(v[b] - v[a], out)
    side = 1.5 * side / np.linalg.norm(side)
    n = len(v)
    middle = (v[a] + v[b]) / 2
    v = np.concatenate([v, [middle + 2 * out + side, middle + 2 * out - side]])
    tent = np.array([(a, b, n), (b, a, n + 1), (a, n, n + 1), (b, n + 1, n)])
    f = np.concatenate([f, tent])
    return Defective(v, f, volume_of(*clean), clean)


def overlap(detail: int, seed: int) -> Defective:
    """Return a tube that is bent until its ends intersect."""
    rng = np.random.default_rng(seed)
    v, f = _sphere(detail)
    v = v * np.array([8, 8, 70.0])
    angle = v[:, 2] / 20 + 0.01 * rng.random()
    radius = 20 + v[:, 0]
    bent = np.stack([radius * np.cos(angle), v[:, 1], radius * np.sin(angle)], axis=1)
    n = 140
    low, high = bent.min(0) - 1, bent.max(0) + 1
    axes = [np.linspace(low[i], high[i], n) for i in range(3)]
    x, y, z = (g.ravel() for g in np.meshgrid(*axes, indexing="ij"))
    r, turn = np.hypot(x, z), np.arctan2(z, x)
    inside = np.zeros(len(x), bool)
    for k in (-1, 0, 1):
        along = 20 * (turn + 2 * np.pi * k)
        inside |= ((r - 20) / 8) ** 2 + (y / 8) ** 2 + (along / 70) ** 2 < 1
    cell = np.prod((high - low) / (n - 1))
    return Defective(bent, f, float(inside.sum() * cell))


def everything(detail: int, seed: int) -> Defective:
    """Combine crossings, holes, slivers and crumbs in a triangle soup."""
    v, f = creature(detail)
    clean, rng = (v.copy(), f.copy()), np.random.default_rng(seed)
    for row in f[rng.choice(len(f), 3, replace=False)]:
        v[row[:2]] = v[row[1::-1]]
    keep = rng.random(len(f)) > 0.002
    ball, g = _sphere(1)
    v, f = _joined([(v, f[keep]), (0.8 * ball + [60, 0, 0], g)])
    return Defective(v[f].reshape(-1, 3), np.arange(3 * len(f)).reshape(-1, 3),
                     volume_of(*clean), clean)  # fmt: skip


BODIES: dict[str, Callable[[int, int], Defective]] = {
    "crossings": crossings, "folds": folds, "open edges": open_edges, "slivers": slivers,
    "genus": genus, "inner shells": inner_shells, "non-manifold": non_manifold,
    "overlap": overlap, "everything": everything,
}  # fmt: skip


def _joined(meshes: list) -> tuple[np.ndarray, np.ndarray]:
    offsets = np.cumsum([0] + [len(v) for v, _ in meshes[:-1]])
    return (
        np.concatenate([v for v, _ in meshes]),
        np.concatenate([f + o for (_, f), o in zip(meshes, offsets, strict=True)]),
    )


def exact_winding(v: np.ndarray, f: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return winding numbers by solid angles (Van Oosterom & Strackee 1983), point by point."""
    out = np.zeros(len(points))
    for i, p in enumerate(points):
        a, b, c = (v[f[:, k]] - p for k in range(3))
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        low = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        out[i] = np.arctan2(top, low).sum() / (2 * np.pi)
    return out


def sampled_distance(a: tuple, b: tuple, count: int = 20000) -> float:
    """Return the largest distance of points sampled on `a` from the triangles `b`, by VTK."""
    import trimesh
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy

    points = trimesh.sample.sample_surface(trimesh.Trimesh(*a, process=False), count, seed=1)[0]
    points = np.concatenate([points, a[0][np.unique(a[1])]])
    other = vtk.vtkPolyData()
    corners, cells = vtk.vtkPoints(), vtk.vtkCellArray()
    corners.SetData(numpy_to_vtk(np.ascontiguousarray(b[0], float), deep=True))
    rows = np.column_stack([np.full(len(b[1]), 3), b[1]]).astype(np.int64)
    cells.ImportLegacyFormat(numpy_to_vtkIdTypeArray(rows.ravel(), deep=True))
    other.SetPoints(corners)
    other.SetPolys(cells)
    distance = vtk.vtkImplicitPolyDataDistance()
    distance.SetInput(other)
    found = vtk.vtkDoubleArray()
    distance.FunctionValue(numpy_to_vtk(points, deep=True), found)
    return float(np.abs(vtk_to_numpy(found)).max())
