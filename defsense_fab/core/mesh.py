"""The tetrahedral mesh and the triangle surface, in rest coordinates (mm)."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from .arrays import Float, Int

_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def _check(vertices: Float, cells: Int, width: int, what: str) -> None:
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        raise ValueError(f"{what}: vertices must be finite, of shape (n, 3)")
    if cells.ndim != 2 or cells.shape[1] != width or len(cells) == 0:
        raise ValueError(f"{what}: cells must have shape (m, {width}) with m > 0")
    if cells.min() < 0 or cells.max() >= len(vertices):
        raise ValueError(f"{what}: a cell names a vertex that does not exist")


def facet_crosses(vertices: Float, faces: Int) -> Float:
    """Of each triangle (m, 3) the cross product (m, 3) of two edges: along its normal by the right
    hand, as long as twice its area."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.asarray(np.cross(b - a, c - a))


@dataclass(frozen=True)
class Surface:
    """Closed triangle surface: `vertices` (n, 3) mm, `faces` (m, 3), outward by the right hand."""

    vertices: Float
    faces: Int

    def __post_init__(self) -> None:
        _check(self.vertices, self.faces, 3, "surface")

    def scatter(self, count: int, rng: np.random.Generator) -> Float:
        """Random points (count, 3) mm spread evenly over the area."""
        corners = self.vertices[self.faces]
        area = np.linalg.norm(facet_crosses(self.vertices, self.faces), axis=1)
        face = rng.choice(len(area), count, p=area / area.sum())
        a, b = np.sqrt(rng.random(count)), rng.random(count)
        weights = np.stack([1 - a, a * (1 - b), a * b], axis=1)
        return np.asarray(np.einsum("ni,nij->nj", weights, corners[face]))

    @property
    def volume(self) -> float:
        """Signed enclosed volume, mm^3 (divergence theorem)."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    @property
    def bounds(self) -> Float:
        """Lowest and highest corner, (2, 3) mm."""
        used = self.vertices[self.faces].reshape(-1, 3)
        return np.array([used.min(0), used.max(0)])

    def compact(self) -> tuple[Surface, Int]:
        """Without vertices that no triangle has, and which (k,) are kept."""
        used, faces = np.unique(self.faces, return_inverse=True)
        return Surface(self.vertices[used], faces.reshape(self.faces.shape)), used


@dataclass(frozen=True)
class TetMesh:
    """Linear tets: `nodes` (n, 3) mm in the rest frame, `tets` (m, 4), all of positive volume."""

    nodes: Float
    tets: Int

    def __post_init__(self) -> None:
        _check(self.nodes, self.tets, 4, "tet mesh")
        if self.volumes.min() <= 0:
            raise ValueError("tet mesh: a tet has no positive volume")

    @property
    def volumes(self) -> Float:
        """Volume of each tet, (m,) mm^3."""
        x = self.nodes[self.tets]
        edges = x[:, 1:] - x[:, :1]
        return np.asarray(np.linalg.det(edges) / 6)

    @property
    def digest(self) -> str:
        """Content hash: a layout names the mesh it was computed on."""
        h = hashlib.sha256(np.ascontiguousarray(self.nodes, dtype="<f8").tobytes())
        h.update(np.ascontiguousarray(self.tets, dtype="<i8").tobytes())
        return h.hexdigest()[:16]

    def boundary(self) -> Surface:
        """The faces that belong to one tet only, outward; vertices are the mesh's nodes."""
        faces = self.tets[:, _FACES].reshape(-1, 3)
        _, first, count = np.unique(
            np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
        )
        return Surface(self.nodes, faces[first[count == 1]])
