"""A surface at rest with its simulated states, the markers attached to it, and a coarser cage."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
from scipy.sparse import csr_array

from ...core.arrays import Bool, Float, Int
from ...core.machine.compiled import compiled
from .rotation import nearest_rotations


@dataclass(frozen=True)
class Cage:
    """A coarse surface that carries a fine one, by linear blend skinning.

    Attributes:
        basis: The coarse surface with its states.
        corners: Coarse vertices that each fine vertex follows (v, 3).
        weights: Their weights (v, 3).
        offsets: Offsets of each fine vertex from them at rest (v, 3, 3), mm.
    """

    basis: SurfaceBasis
    corners: Int
    weights: Float
    offsets: Float

    @classmethod
    def of(cls, fine: SurfaceBasis, count: int) -> Cage:
        """Build a cage of about `count` vertices for a fine surface."""
        vertices, triangles = decimated(fine.vertices, fine.triangles, count)
        below, shares = nearest_points(vertices, fine.vertices, fine.triangles)
        states = np.einsum("ck,sckd->scd", shares, fine.states[:, below])
        fixed = (fine.fixed[below] | (shares == 0)).all(axis=1)
        basis = SurfaceBasis(vertices, triangles, states, fixed)
        corners, weights = nearest_points(fine.vertices, vertices, triangles)
        return cls(basis, corners, weights, fine.vertices[:, None] - vertices[corners])

    def surface(self, x: Float, rotations: Float) -> Float:
        """Return fine vertices (v, 3), mm, for the cage's vertices (c, 3) and rotations (c, 9)."""
        out = np.empty((len(self.corners), 3))
        _carry(self.corners, self.weights, self.offsets, x, rotations, out)
        return out


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def _carry(
    corners: Int, weights: Float, offsets: Float, x: Float, rotations: Float, out: Float
) -> None:
    for v in range(len(corners)):
        s0, s1, s2 = 0.0, 0.0, 0.0
        for k in range(3):
            i, w = corners[v, k], weights[v, k]
            r = rotations[i]
            a0, a1, a2 = offsets[v, k, 0], offsets[v, k, 1], offsets[v, k, 2]
            s0 += w * (x[i, 0] + r[0] * a0 + r[1] * a1 + r[2] * a2)
            s1 += w * (x[i, 1] + r[3] * a0 + r[4] * a1 + r[5] * a2)
            s2 += w * (x[i, 2] + r[6] * a0 + r[7] * a1 + r[8] * a2)
        out[v, 0], out[v, 1], out[v, 2] = s0, s1, s2


@dataclass(frozen=True)
class Attachment:
    """Where m markers sit on a surface, and how they move with it.

    Attributes:
        corners: Vertices that each marker follows (m, 3).
        weights: Their weights (m, 3).
        offset: Offset of each marker from the surface at rest (m, 3), mm; it rotates with it.
    """

    corners: Int
    weights: Float
    offset: Float

    @classmethod
    def of(cls, markers: Float, vertices: Float, triangles: Int) -> Attachment:
        """Attach markers (m, 3), mm, to the nearest points of a surface at rest."""
        corners, weights = nearest_points(markers, vertices, triangles)
        on = np.einsum("mk,mkd->md", weights, vertices[corners])
        return cls(corners, weights, markers - on)

    def matrix(self, count: int) -> csr_array:
        """Return the weights as a matrix (m, count), for a surface of `count` vertices."""
        rows = np.repeat(np.arange(len(self.corners)), 3)
        shape = (len(self.corners), count)
        return csr_array((self.weights.ravel(), (rows, self.corners.ravel())), shape=shape)

    def on_surface(self, x: Float) -> Float:
        """Return the points on the surface below the markers (m, 3), mm, for vertices x (v, 3)."""
        return np.asarray(np.einsum("mk,mkd->md", self.weights, x[self.corners]))

    def stand_off(self, rotations: Float) -> Float:
        """Return the rotated offsets of the markers (m, 3), mm, by vertex rotations (v, 9)."""
        mean = np.einsum("mk,mkd->md", self.weights, rotations[self.corners])
        turned = nearest_rotations(mean.reshape(-1, 3, 3))
        return np.asarray(np.einsum("mij,mj->mi", turned, self.offset))


_MAX_COTANGENT = 1e3  # larger ones belong to triangles without area


def laplacian(vertices: Float, triangles: Int) -> csr_array:
    """Return the cotangent Laplacian (v, v), positive semidefinite and without unit."""
    matrix = csr_array(-igl.cotmatrix(vertices, triangles.astype(np.int64)))
    matrix.sum_duplicates()
    off = matrix.tocoo()
    is_off_diagonal = off.row != off.col
    weights = np.clip(
        np.nan_to_num(-off.data[is_off_diagonal], nan=0.0), -_MAX_COTANGENT, _MAX_COTANGENT
    )
    weights[weights == 0.0] = 1e-12  # edges of right-angled grids stay connected
    between = csr_array(
        (weights, (off.row[is_off_diagonal], off.col[is_off_diagonal])), shape=matrix.shape
    )
    diagonal = csr_array((between.sum(axis=1), (np.arange(len(vertices)),) * 2), shape=matrix.shape)
    out = csr_array(diagonal - between)
    out.sort_indices()
    return out


def vertex_areas(vertices: Float, triangles: Int) -> Float:
    """Return a third of the area of the triangles around each vertex (v,), mm^2."""
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 6
    return np.asarray(np.bincount(triangles.ravel(), np.repeat(area, 3), len(vertices)), float)


def nearest_points(points: Float, vertices: Float, triangles: Int) -> tuple[Int, Float]:
    """Return the triangles (p, 3) and weights (p, 3) of the nearest points to points (p, 3)."""
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
    """Return a mesh of about `count` vertices, by collapsing the shortest edges."""
    coarse, faces = igl.decimate(
        np.asfortranarray(vertices), np.asfortranarray(triangles, np.int32), 2 * count
    )[:2]
    used, faces = np.unique(np.asarray(faces), return_inverse=True)
    return np.ascontiguousarray(np.asarray(coarse)[used]), faces.reshape(-1, 3).astype(np.int64)


@dataclass(frozen=True)
class SurfaceBasis:
    """A surface at rest, and its simulated states.

    Attributes:
        vertices: Vertices at rest (v, 3), mm, each in a triangle.
        triangles: Triangles (f, 3).
        states: Displacements in the simulated states (s, v, 3), mm; s may be 0.
        fixed: Which vertices no state moves (v,).

    Raises:
        ValueError: The arrays do not fit each other.
    """

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
        """Return a surface without simulated states."""
        count = len(vertices)
        return cls(
            np.asarray(vertices, float),
            np.asarray(triangles, np.int64),
            np.zeros((0, count, 3)),
            np.zeros(count, bool),
        )

    @property
    def size(self) -> float:
        """Diagonal of the bounding box, mm."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))
