"""What is known of a surface before it moves: its shape at rest, and simulated states."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
from scipy.sparse import csr_array

from ...core.arrays import Bool, Float, Int
from ...core.machine.compiled import compiled
from .rotation import nearest_rotations

# A coarse surface that carries a fine one along.


@dataclass(frozen=True)
class Cage:
    """The coarse surface as a `basis` of its own; each of v fine vertices follows three of the
    cage's `corners` (v, 3) by `weights` (v, 3): it stands at `away` (v, 3, 3) mm from them at rest,
    and turns with each (linear blend skinning)."""

    basis: SurfaceBasis
    corners: Int
    weights: Float
    away: Float

    @classmethod
    def of(cls, fine: SurfaceBasis, count: int) -> Cage:
        """Of about `count` vertices."""
        vertices, triangles = decimated(fine.vertices, fine.triangles, count)
        below, shares = nearest_points(vertices, fine.vertices, fine.triangles)
        states = np.einsum("ck,sckd->scd", shares, fine.states[:, below])
        fixed = (fine.fixed[below] | (shares == 0)).all(axis=1)
        basis = SurfaceBasis(vertices, triangles, states, fixed)
        corners, weights = nearest_points(fine.vertices, vertices, triangles)
        return cls(basis, corners, weights, fine.vertices[:, None] - vertices[corners])

    def surface(self, x: Float, rotations: Float) -> Float:
        """Fine vertices (v, 3) mm, of the cage's (c, 3) and their rotations (c, 9)."""
        out = np.empty((len(self.corners), 3))
        _carry(self.corners, self.weights, self.away, x, rotations, out)
        return out


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def _carry(
    corners: Int, weights: Float, away: Float, x: Float, rotations: Float, out: Float
) -> None:
    for v in range(len(corners)):
        s0, s1, s2 = 0.0, 0.0, 0.0
        for k in range(3):
            i, w = corners[v, k], weights[v, k]
            r = rotations[i]
            a0, a1, a2 = away[v, k, 0], away[v, k, 1], away[v, k, 2]
            s0 += w * (x[i, 0] + r[0] * a0 + r[1] * a1 + r[2] * a2)
            s1 += w * (x[i, 1] + r[3] * a0 + r[4] * a1 + r[5] * a2)
            s2 += w * (x[i, 2] + r[6] * a0 + r[7] * a1 + r[8] * a2)
        out[v, 0], out[v, 1], out[v, 2] = s0, s1, s2


# Where markers sit on the surface, and how they move with it.


@dataclass(frozen=True)
class Attachment:
    """Each of m markers follows three vertices `corners` (m, 3) by `weights` (m, 3), and stands
    off their surface by `offset` (m, 3) mm at rest, which turns with it."""

    corners: Int
    weights: Float
    offset: Float

    @classmethod
    def of(cls, markers: Float, vertices: Float, triangles: Int) -> Attachment:
        """Of markers (m, 3) mm, to the nearest points of a surface at rest."""
        corners, weights = nearest_points(markers, vertices, triangles)
        on = np.einsum("mk,mkd->md", weights, vertices[corners])
        return cls(corners, weights, markers - on)

    def matrix(self, count: int) -> csr_array:
        """(m, count): places on the surface of `count` vertices."""
        rows = np.repeat(np.arange(len(self.corners)), 3)
        shape = (len(self.corners), count)
        return csr_array((self.weights.ravel(), (rows, self.corners.ravel())), shape=shape)

    def on_surface(self, x: Float) -> Float:
        """(m, 3) mm below the markers, of vertices x (v, 3)."""
        return np.asarray(np.einsum("mk,mkd->md", self.weights, x[self.corners]))

    def stand_off(self, rotations: Float) -> Float:
        """(m, 3) mm from the surface to the markers, of the vertices' rotations (v, 9)."""
        mean = np.einsum("mk,mkd->md", self.weights, rotations[self.corners])
        turned = nearest_rotations(mean.reshape(-1, 3, 3))
        return np.asarray(np.einsum("mij,mj->mi", turned, self.offset))


# What libigl computes of a triangle surface: Laplacian, areas, nearest points, fewer triangles.

_STEEPEST = 1e3  # cotangents beyond are those of triangles without area


def laplacian(vertices: Float, triangles: Int) -> csr_array:
    """The cotangent Laplacian (v, v), positive semidefinite, without unit."""
    matrix = csr_array(-igl.cotmatrix(vertices, triangles.astype(np.int64)))
    matrix.sum_duplicates()
    off = matrix.tocoo()
    apart = off.row != off.col
    weights = np.clip(np.nan_to_num(-off.data[apart], nan=0.0), -_STEEPEST, _STEEPEST)
    weights[weights == 0.0] = 1e-12  # right-angled grids: an edge stays a neighbour
    between = csr_array((weights, (off.row[apart], off.col[apart])), shape=matrix.shape)
    diagonal = csr_array((between.sum(axis=1), (np.arange(len(vertices)),) * 2), shape=matrix.shape)
    out = csr_array(diagonal - between)
    out.sort_indices()
    return out


def vertex_areas(vertices: Float, triangles: Int) -> Float:
    """A third of the triangles around each, (v,) mm^2."""
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 6
    return np.asarray(np.bincount(triangles.ravel(), np.repeat(area, 3), len(vertices)), float)


def nearest_points(points: Float, vertices: Float, triangles: Int) -> tuple[Int, Float]:
    """The triangle's vertices (p, 3) and weights (p, 3) of the nearest point to each (p, 3)."""
    triangles = np.ascontiguousarray(triangles, np.int64)
    _, face, at = igl.point_mesh_squared_distance(
        np.ascontiguousarray(points), np.ascontiguousarray(vertices), triangles
    )[:3]
    face = np.asarray(face).ravel()
    a, b, c = (np.ascontiguousarray(vertices[triangles[face, k]]) for k in range(3))
    weights = _barycentric(np.asarray(at), a, b, c)
    return triangles[face], weights


def _barycentric(at: Float, a: Float, b: Float, c: Float) -> Float:
    u, v, w = b - a, c - a, at - a
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    wu, wv = (w * u).sum(1), (w * v).sum(1)
    whole = np.maximum(uu * vv - uv * uv, 1e-300)
    second, third = (vv * wu - uv * wv) / whole, (uu * wv - uv * wu) / whole
    weights = np.clip(np.stack([1 - second - third, second, third], axis=1), 0.0, 1.0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def decimated(vertices: Float, triangles: Int, count: int) -> tuple[Float, Int]:
    """About `count` vertices, by collapsing the shortest edges to their middles: even meshes."""
    coarse, faces = igl.decimate(
        np.asfortranarray(vertices), np.asfortranarray(triangles, np.int32), 2 * count
    )[:2]
    used, faces = np.unique(np.asarray(faces), return_inverse=True)
    return np.ascontiguousarray(np.asarray(coarse)[used]), faces.reshape(-1, 3).astype(np.int64)


@dataclass(frozen=True)
class SurfaceBasis:
    """`vertices` (v, 3) mm at rest and `triangles` (f, 3), each vertex in one at least;
    displacements of simulated `states` (s, v, 3) mm, which may be none; `fixed` (v,) vertices that
    no state moves."""

    vertices: Float
    triangles: Int
    states: Float
    fixed: Bool

    def __post_init__(self) -> None:
        count = len(self.vertices)
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or count < 4:
            raise ValueError("surface basis: vertices must have shape (v, 3) with v > 3")
        if self.triangles.ndim != 2 or self.triangles.shape[1] != 3:
            raise ValueError("surface basis: triangles must have shape (f, 3)")
        if self.states.shape[1:] != (count, 3) or self.fixed.shape != (count,):
            raise ValueError("surface basis: states must be (s, v, 3), fixed (v,)")
        if not (np.isfinite(self.vertices).all() and np.isfinite(self.states).all()):
            raise ValueError("surface basis: vertices and states must be finite")
        if not np.array_equal(np.unique(self.triangles), np.arange(count)):
            raise ValueError("surface basis: triangles must name every vertex, and no others")
        if self.fixed.all():
            raise ValueError("surface basis: some vertex must be free")

    @classmethod
    def at_rest(cls, vertices: Float, triangles: Int) -> SurfaceBasis:
        """Without states: nothing is known of how it deforms."""
        count = len(vertices)
        return cls(
            np.asarray(vertices, float), np.asarray(triangles, np.int64), np.zeros((0, count, 3)),
            np.zeros(count, bool),
        )  # fmt: skip

    @property
    def size(self) -> float:
        """Diagonal of the bounding box, mm."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))
