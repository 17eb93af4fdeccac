"""Integrate energy, forces and tangent stiffness over quadratic tetrahedra with straight sides.

Edge nodes follow VTK's order (0,1) (1,2) (0,2) (0,3) (1,3) (2,3). Each tet has a four-point
quadrature of degree 2. Functions take the deformation gradients as an argument, so that forces and
tangents can also be computed at gradients that belong to no displacement field
(`solver/convergence_aids.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.machine import kernels
from ...core.mesh import TetMesh
from .material import Material
from .threads import run_in_chunks

EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
_A, _B = 0.585410196624968454, 0.138196601125010515
QUADRATURE = np.array([[_A, _B, _B, _B], [_B, _A, _B, _B], [_B, _B, _A, _B], [_B, _B, _B, _A]])


def shape_functions(bary: Float) -> Float:
    """Return the shape functions (..., 10) at barycentric coordinates (..., 4)."""
    corner = bary * (2 * bary - 1)
    edge = 4 * bary[..., EDGES[:, 0]] * bary[..., EDGES[:, 1]]
    return np.concatenate([corner, edge], axis=-1)


def shape_derivatives(bary: Float) -> Float:
    """Return the derivatives (..., 10, 4) of the shape functions by the barycentric coordinates."""
    out = np.zeros((*bary.shape[:-1], 10, 4))
    for i in range(4):
        out[..., i, i] = 4 * bary[..., i] - 1
    for e, (i, j) in enumerate(EDGES):
        out[..., 4 + e, i] = 4 * bary[..., j]
        out[..., 4 + e, j] = 4 * bary[..., i]
    return out


@dataclass(frozen=True)
class QuadraticMesh:
    """A mesh of quadratic tetrahedra at rest.

    Attributes:
        nodes: (n, 3) mm, corners first, then edge midpoints.
        cells: (m, 10) node numbers of each tet.
        bary_gradient: (m, 4, 3) 1/mm, constant gradients of the barycentric coordinates.
        gradient: (m, 4, 10, 3) 1/mm, gradients of the shape functions at the quadrature points.
        weight: (m,) mm^3, weight of each quadrature point: a quarter of the tet's volume.
    """

    nodes: Float
    cells: Int
    bary_gradient: Float
    gradient: Float
    weight: Float

    @classmethod
    def from_linear(cls, mesh: TetMesh) -> QuadraticMesh:
        """Create the quadratic mesh of a linear one by adding the midpoints of its edges."""
        edges = np.sort(mesh.tets[:, EDGES].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        nodes = np.concatenate([mesh.nodes, mesh.nodes[unique].mean(axis=1)])
        cells = np.concatenate([mesh.tets, len(mesh.nodes) + inverse.reshape(-1, 6)], axis=1)
        x = mesh.nodes[mesh.tets]
        inner = np.linalg.inv(x[:, 1:] - x[:, :1]).transpose(0, 2, 1)
        bary = np.concatenate([-inner.sum(1, keepdims=True), inner], axis=1)
        gradient = np.einsum("qnb,mbj->mqnj", shape_derivatives(QUADRATURE), bary)
        return cls(
            nodes,
            cells,
            np.ascontiguousarray(bary),
            np.ascontiguousarray(gradient),
            mesh.volumes / 4,
        )

    @property
    def volume(self) -> float:
        """Rest volume, mm^3."""
        return float(4 * self.weight.sum())

    @property
    def edge_length(self) -> float:
        """Mean length of the tets' edges, mm."""
        corners = self.nodes[self.cells[:, EDGES]]
        return float(np.linalg.norm(corners[:, :, 0] - corners[:, :, 1], axis=-1).mean())

    def subset(self, keep: Float) -> QuadraticMesh:
        """Return a mesh of the same nodes with the cells that `keep` (m,) bool selects."""
        return QuadraticMesh(
            self.nodes,
            self.cells[keep],
            self.bary_gradient[keep],
            self.gradient[keep],
            self.weight[keep],
        )


#: Nodes of the four faces of a tet, outward: corners, then the edges between them.
_FACES = np.array([[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]])


def boundary_faces(mesh: QuadraticMesh) -> Int:
    """Return the faces (t, 6) of the surface, oriented outward.

    Each row holds the node numbers of three corners, then of the edges (0,1) (1,2) (2,0).
    """
    faces = mesh.cells[:, _FACES].reshape(-1, 6)
    _, first, count = np.unique(
        np.sort(faces[:, :3], axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.asarray(faces[np.sort(first[count == 1])])


def deformation_gradient(mesh: QuadraticMesh, u: Float, threads: int = 1) -> Float:
    """Return F (m, 4, 3, 3) at the quadrature points for displacements u (n, 3) mm."""
    out = np.empty((len(mesh.cells), 4, 3, 3))
    x = mesh.nodes + u
    run_in_chunks(
        lambda a, b: kernels.gradients(x, mesh.cells, mesh.gradient, a, b, out), len(out), threads
    )
    return out


def volume_ratios(G: Float, F: Float, threads: int = 1) -> Float:
    """Return the volume ratios (m, 4) at F, linearized about G.

    Both are (m, 4, 3, 3); where G equals F the ratio is det F.
    """
    out = np.empty(F.shape[:2])
    run_in_chunks(lambda a, b: kernels.volume_ratios(G, F, a, b, out), len(out), threads)
    return out


def energy(mesh: QuadraticMesh, material: Material, F: Float, threads: int = 1) -> float:
    """Return the stored energy (N mm) at F (m, 4, 3, 3), infinite outside the material's domain."""
    sums, law = np.empty(len(mesh.cells)), material.law
    run_in_chunks(
        lambda a, b: kernels.energies(F, mesh.weight, law, a, b, sums), len(sums), threads
    )
    return float(sums.sum())


def forces(mesh: QuadraticMesh, material: Material, F: Float, threads: int = 1) -> Float:
    """Return the internal nodal forces (n, 3) N at F (m, 4, 3, 3).

    They are the gradient of the energy where F belongs to a displacement field.
    """
    local, law = np.empty((len(mesh.cells), 10, 3)), material.law
    run_in_chunks(
        lambda a, b: kernels.forces(F, mesh.gradient, mesh.weight, law, a, b, local),
        len(local),
        threads,
    )
    return scatter_nodes(mesh, local)


def pressure_forces(mesh: QuadraticMesh, pressure: Float, F: Float) -> Float:
    """Return the nodal forces (n, 3) N of the stress p cof F, with p (m, 4) MPa."""
    cof = np.stack([np.cross(F[..., i - 2, :], F[..., i - 1, :]) for i in range(3)], axis=-2)
    local = np.einsum("m,mq,mqij,mqnj->mni", mesh.weight, pressure, cof, mesh.gradient)
    return scatter_nodes(mesh, np.ascontiguousarray(local))


def scatter_nodes(mesh: QuadraticMesh, local: Float) -> Float:
    """Sum the elements' nodal values (m, 10, 3) at the nodes of the mesh, (n, 3)."""
    out = np.zeros_like(mesh.nodes)
    kernels.scatter(mesh.cells, local, out)
    return out


def stiffness(
    mesh: QuadraticMesh, material: Material, F: Float, share: float, threads: int = 1
) -> Float:
    """Return the element tangents (m, 30, 30) N/mm; row 3 * node + axis.

    Args:
        mesh: The mesh.
        material: Its material.
        F: Deformation gradients (m, 4, 3, 3).
        share: Share (0 to 1) of the negative part of d2W/dF2 that is removed at each point.
        threads: Largest number of threads.
    """
    out, law = np.empty((len(mesh.cells), 30, 30)), material.law
    run_in_chunks(
        lambda a, b: kernels.stiffness(F, mesh.gradient, mesh.weight, law, share, a, b, out),
        len(out),
        threads,
    )
    return out


def linearized_forces(
    mesh: QuadraticMesh, material: Material, G: Float, F: Float, threads: int = 1
) -> Float:
    """Return the nodal forces (n, 3) N at F of the energy linearized about G.

    Both gradients are (m, 4, 3, 3). The tangent is made positive semidefinite, like the matrix that
    the forces are used with.
    """
    local, step, law = np.empty((len(mesh.cells), 10, 3)), F - G, material.law
    run_in_chunks(
        lambda a, b: kernels.linearized_forces(
            G, step, mesh.gradient, mesh.weight, law, a, b, local
        ),
        len(local),
        threads,
    )
    return scatter_nodes(mesh, local)
