"""Quadratic tets with straight sides: shape functions, energy, forces, tangent stiffness.

Edge nodes follow VTK's order (0,1) (1,2) (0,2) (0,3) (1,3) (2,3). Four-point quadrature
(degree 2) over each tet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from ..core.arrays import Float, Int
from ..core.mesh import TetMesh
from .material import NeoHookean

EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
_A, _B = 0.585410196624968454, 0.138196601125010515
QUADRATURE = np.array([[_A, _B, _B, _B], [_B, _A, _B, _B], [_B, _B, _A, _B], [_B, _B, _B, _A]])


def shape(bary: Float) -> Float:
    """Shape functions (..., 10) at barycentric coordinates (..., 4)."""
    corner = bary * (2 * bary - 1)
    edge = 4 * bary[..., EDGES[:, 0]] * bary[..., EDGES[:, 1]]
    return np.concatenate([corner, edge], axis=-1)


def shape_by_bary(bary: Float) -> Float:
    """Derivatives of the shape functions by the barycentric coordinates, (..., 10, 4)."""
    out = np.zeros((*bary.shape[:-1], 10, 4))
    for i in range(4):
        out[..., i, i] = 4 * bary[..., i] - 1
    for e, (i, j) in enumerate(EDGES):
        out[..., 4 + e, i] = 4 * bary[..., j]
        out[..., 4 + e, j] = 4 * bary[..., i]
    return out


@dataclass(frozen=True)
class QuadraticMesh:
    """`nodes` (n, 3) mm: corners then edge midpoints; `cells` (m, 10).

    `bary_gradient` (m, 4, 3) is the constant gradient of the barycentric coordinates;
    `gradient` (m, 4, 10, 3) that of the shape functions at the quadrature points; `weight`
    (m,) a quarter of the volume.
    """

    nodes: Float
    cells: Int
    bary_gradient: Float
    gradient: Float
    weight: Float

    @classmethod
    def from_linear(cls, mesh: TetMesh) -> QuadraticMesh:
        edges = np.sort(mesh.tets[:, EDGES].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        nodes = np.concatenate([mesh.nodes, mesh.nodes[unique].mean(axis=1)])
        cells = np.concatenate([mesh.tets, len(mesh.nodes) + inverse.reshape(-1, 6)], axis=1)
        x = mesh.nodes[mesh.tets]
        inner = np.linalg.inv(x[:, 1:] - x[:, :1]).transpose(0, 2, 1)
        bary = np.concatenate([-inner.sum(1, keepdims=True), inner], axis=1)
        gradient = np.einsum("qnb,mbj->mqnj", shape_by_bary(QUADRATURE), bary)
        return cls(nodes, cells, bary, np.ascontiguousarray(gradient), mesh.volumes / 4)


def energy(mesh: QuadraticMesh, material: NeoHookean, u: Float) -> float:
    """Stored energy (N mm) of displacement `u` (n, 3); inf where an element inverts."""
    return float(
        _energy(mesh.nodes + u, mesh.cells, mesh.gradient, mesh.weight, material.mu, material.kappa)
    )


def forces(mesh: QuadraticMesh, material: NeoHookean, u: Float) -> Float:
    """Internal forces (n, 3) N: the gradient of the energy."""
    x = mesh.nodes + u
    out: Float = _forces(x, mesh.cells, mesh.gradient, mesh.weight, material.mu, material.kappa)
    return out


def stiffness(mesh: QuadraticMesh, material: NeoHookean, u: Float, project: bool) -> Float:
    """Element tangents (m, 30, 30), N/mm, row 3 * node + axis.

    With `project`, negative eigenvalues of the energy's Hessian by F are set to zero at each
    quadrature point, in the closed form of the eigensystem of isotropic energies (Smith,
    De Goes & Kim 2019, "Analytic Eigensystems for Isotropic Distortion Energies").
    """
    x = mesh.nodes + u
    out: Float = _stiffness(
        x, mesh.cells, mesh.gradient, mesh.weight, material.mu, material.kappa, project
    )
    return out


@numba.njit(cache=True, inline="always")
def _deformation_gradient(x, cells, gradient, e, q, F):  # type: ignore[no-untyped-def]
    for a in range(3):
        for j in range(3):
            s = 0.0
            for n in range(10):
                s += x[cells[e, n], a] * gradient[e, q, n, j]
            F[a, j] = s


@numba.njit(cache=True, inline="always")
def _cofactor(F, C):  # type: ignore[no-untyped-def]
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            C[i, j] = F[i1, j1] * F[i2, j2] - F[i1, j2] * F[i2, j1]
    return F[0, 0] * C[0, 0] + F[0, 1] * C[0, 1] + F[0, 2] * C[0, 2]


@numba.njit(cache=True)
def _energy(x, cells, gradient, weight, mu, kappa):  # type: ignore[no-untyped-def]
    F, C = np.empty((3, 3)), np.empty((3, 3))
    total = 0.0
    for e in range(len(cells)):
        for q in range(4):
            _deformation_gradient(x, cells, gradient, e, q, F)
            J = _cofactor(F, C)
            if J <= 0:
                return np.inf
            i1 = (F * F).sum()
            total += weight[e] * (0.5 * mu * (J ** (-2 / 3) * i1 - 3) + 0.5 * kappa * (J - 1) ** 2)
    return total


@numba.njit(cache=True)
def _forces(x, cells, gradient, weight, mu, kappa):  # type: ignore[no-untyped-def]
    F, C, P = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    out = np.zeros_like(x)
    for e in range(len(cells)):
        for q in range(4):
            _deformation_gradient(x, cells, gradient, e, q, F)
            J = _cofactor(F, C)
            i1 = (F * F).sum()
            a = mu * J ** (-2 / 3)
            for i in range(3):
                for j in range(3):
                    P[i, j] = weight[e] * (
                        a * (F[i, j] - i1 / (3 * J) * C[i, j]) + kappa * (J - 1) * C[i, j]
                    )
            for n in range(10):
                for i in range(3):
                    s = 0.0
                    for j in range(3):
                        s += P[i, j] * gradient[e, q, n, j]
                    out[cells[e, n], i] += s
    return out


@numba.njit(cache=True)
def _hessian(F, mu, kappa, project, H):  # type: ignore[no-untyped-def]
    """Fill H (9, 9), the Hessian of the energy by F, from the principal stretches."""
    U, s, Vt = np.linalg.svd(F)
    J = s[0] * s[1] * s[2]
    if (
        U[0, 0] * (U[1, 1] * U[2, 2] - U[1, 2] * U[2, 1])
        - U[0, 1] * (U[1, 0] * U[2, 2] - U[1, 2] * U[2, 0])
        + U[0, 2] * (U[1, 0] * U[2, 1] - U[1, 1] * U[2, 0])
        < 0
    ):
        U = -U
        Vt = -Vt
    a = mu * J ** (-2 / 3)
    i1 = s[0] ** 2 + s[1] ** 2 + s[2] ** 2
    A = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            if i == j:
                A[i, i] = (
                    a
                    * (
                        -2 / (3 * s[i]) * (s[i] - i1 / (3 * s[i]))
                        + 1
                        + i1 / (3 * s[i] ** 2)
                        - 2 / 3
                    )
                    + kappa * J * J / s[i] ** 2
                )
            else:
                A[i, j] = a * (
                    -2 / (3 * s[j]) * (s[i] - i1 / (3 * s[i])) - 2 * s[j] / (3 * s[i])
                ) + kappa * (2 * J - 1) * J / (s[i] * s[j])
    if project:
        w, Q = np.linalg.eigh(A)
        for k in range(3):
            w[k] = max(w[k], 0.0)
        A = (Q * w) @ Q.T
    H[:] = 0.0
    D = np.empty((3, 9))
    for i in range(3):
        for r in range(3):
            for c in range(3):
                D[i, 3 * r + c] = U[r, i] * Vt[i, c]
    for i in range(3):
        for j in range(3):
            for r in range(9):
                for c in range(9):
                    H[r, c] += A[i, j] * D[i, r] * D[j, c]
    m = np.empty(9)
    for i in range(3):
        for j in range(i + 1, 3):
            sij = s[i] * s[j]
            flip = a * (1 + i1 / (3 * sij)) - kappa * (J - 1) * J / sij
            twist = a * (1 - i1 / (3 * sij)) + kappa * (J - 1) * J / sij
            for sign in (1.0, -1.0):
                value = flip if sign > 0 else twist
                if project and value < 0:
                    continue
                for r in range(3):
                    for c in range(3):
                        m[3 * r + c] = U[r, i] * Vt[j, c] + sign * U[r, j] * Vt[i, c]
                for r in range(9):
                    for c in range(9):
                        H[r, c] += 0.5 * value * m[r] * m[c]


@numba.njit(cache=True, parallel=True)
def _stiffness(x, cells, gradient, weight, mu, kappa, project):  # type: ignore[no-untyped-def]
    out = np.zeros((len(cells), 30, 30))
    for e in numba.prange(len(cells)):
        F, H, T = np.empty((3, 3)), np.empty((9, 9)), np.empty((9, 30))
        for q in range(4):
            _deformation_gradient(x, cells, gradient, e, q, F)
            _hessian(F, mu, kappa, project, H)
            for r in range(9):
                for m in range(10):
                    for b in range(3):
                        t = 0.0
                        for k in range(3):
                            t += H[r, 3 * b + k] * gradient[e, q, m, k]
                        T[r, 3 * m + b] = t * weight[e]
            for n in range(10):
                for i in range(3):
                    for c in range(30):
                        s = 0.0
                        for j in range(3):
                            s += gradient[e, q, n, j] * T[3 * i + j, c]
                        out[e, 3 * n + i, c] += s
    return out
