"""Triangle surfaces and tetrahedral meshes, in the rest frame (mm)."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from .arrays import Float, Int

_TET_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def _check_mesh(vertices: Float, cells: Int, width: int, kind: str) -> None:
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        raise ValueError(f"{kind}: vertices must be finite and have the shape (n, 3)")
    if cells.ndim != 2 or cells.shape[1] != width or len(cells) == 0:
        raise ValueError(f"{kind}: cells must have the shape (m, {width}) with m > 0")
    if cells.min() < 0 or cells.max() >= len(vertices):
        raise ValueError(f"{kind}: a cell refers to a vertex that does not exist")


def facet_crosses(vertices: Float, faces: Int) -> Float:
    """Return the cross products of two edges of each triangle.

    Args:
        vertices: Vertices (n, 3), mm.
        faces: Triangles (m, 3).

    Returns:
        Vectors (m, 3) along the triangles' normals by the right-hand rule, twice as long as their
        areas, mm^2.
    """
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.asarray(np.cross(b - a, c - a))


def triangle_edges(faces: Int) -> tuple[Int, Int, Int]:
    """Return the edges of triangles.

    Args:
        faces: Triangles (m, 3).

    Returns:
        The edges (k, 2), sorted; how many triangles each has (k,); and the edge indices (3 m,) of
        the three edges of each triangle, in a row.
    """
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    base = int(faces.max(initial=0)) + 1
    keys, index, count = np.unique(
        ends.min(axis=1) * base + ends.max(axis=1), return_inverse=True, return_counts=True
    )
    return np.stack([keys // base, keys % base], axis=1), count, index.reshape(-1)


@dataclass(frozen=True)
class Surface:
    """Closed triangle surface.

    Attributes:
        vertices: Vertices (n, 3), mm.
        faces: Triangles (m, 3), facing outward by the right-hand rule.

    Raises:
        ValueError: A shape or an index is invalid.
    """

    vertices: Float
    faces: Int

    def __post_init__(self) -> None:
        _check_mesh(self.vertices, self.faces, 3, "surface")

    def scatter(self, count: int, rng: np.random.Generator) -> Float:
        """Return random points (count, 3) in mm, spread evenly over the area."""
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
    def centroid(self) -> Float:
        """Center of mass (3,), mm: each facet and the origin span a tetrahedron."""
        corners = self.vertices[self.faces]
        volume = np.linalg.det(corners)
        return np.asarray(volume @ corners.sum(1) / (4 * volume.sum()))

    @property
    def area(self) -> float:
        """Area, mm^2."""
        return float(np.linalg.norm(facet_crosses(self.vertices, self.faces), axis=1).sum() / 2)

    @property
    def normals(self) -> Float:
        """Unit normals (m, 3) of the triangles; zero for triangles without area."""
        crosses = facet_crosses(self.vertices, self.faces)
        lengths = np.linalg.norm(crosses, axis=1, keepdims=True)
        return np.asarray(crosses / np.where(lengths > 0, lengths, 1.0))

    @property
    def bounds(self) -> Float:
        """Lowest and highest corner (2, 3), mm."""
        corners = self.vertices[self.faces].reshape(-1, 3)
        return np.array([corners.min(0), corners.max(0)])

    def compact(self) -> tuple[Surface, Int]:
        """Return the surface without unused vertices, and the indices (k,) of the used ones."""
        used, faces = np.unique(self.faces, return_inverse=True)
        return Surface(self.vertices[used], faces.reshape(self.faces.shape)), used


@dataclass(frozen=True)
class TetMesh:
    """Mesh of linear tetrahedra.

    Attributes:
        nodes: Nodes (n, 3) in the rest frame, mm.
        tets: Tetrahedra (m, 4), all of positive volume.

    Raises:
        ValueError: A shape, an index or a volume is invalid.
    """

    nodes: Float
    tets: Int

    def __post_init__(self) -> None:
        _check_mesh(self.nodes, self.tets, 4, "tet mesh")
        if self.volumes.min() <= 0:
            raise ValueError("tet mesh: a tet has no positive volume")

    @property
    def volumes(self) -> Float:
        """Volume of each tet (m,), mm^3."""
        x = self.nodes[self.tets]
        edges = x[:, 1:] - x[:, :1]
        return np.asarray(np.linalg.det(edges) / 6)

    @property
    def digest(self) -> str:
        """Hash of the content, by which a layout names the mesh it was computed on."""
        h = hashlib.sha256(np.ascontiguousarray(self.nodes, dtype="<f8").tobytes())
        h.update(np.ascontiguousarray(self.tets, dtype="<i8").tobytes())
        return h.hexdigest()[:16]

    def boundary(self) -> Surface:
        """Return the faces that belong to one tet only; its vertices are all of the nodes."""
        faces = self.tets[:, _TET_FACES].reshape(-1, 3)
        _, first, count = np.unique(
            np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
        )
        return Surface(self.nodes, faces[first[count == 1]])
