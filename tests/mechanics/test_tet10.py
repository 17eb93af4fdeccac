"""Energy, forces and tangent against each other, and invariances."""

import numpy as np
import pytest

from defsense_fab.mechanics import tet10
from defsense_fab.mechanics.material import NeoHookean
from defsense_fab.mechanics.pose import rotation_matrix
from defsense_fab.mechanics.tet10 import QuadraticMesh

MATERIAL = NeoHookean(0.2, 5.0)


@pytest.fixture(scope="module")
def mesh(bar_mesh):
    return QuadraticMesh.from_linear(bar_mesh)


def smooth(mesh, seed):
    """A smooth random displacement."""
    rng = np.random.default_rng(seed)
    return 0.5 * np.sin(mesh.nodes @ rng.normal(0, 0.1, (3, 3))) @ rng.normal(size=(3, 3))


def test_forces_are_the_gradient_of_the_energy(mesh):
    u, d, h = smooth(mesh, 1), smooth(mesh, 2), 1e-5
    slope = (tet10.energy(mesh, MATERIAL, u + h * d) - tet10.energy(mesh, MATERIAL, u - h * d)) / (
        2 * h
    )
    assert slope == pytest.approx((tet10.forces(mesh, MATERIAL, u) * d).sum(), rel=1e-6)


def test_tangent_is_the_gradient_of_the_forces(mesh):
    u, d, h = smooth(mesh, 1), smooth(mesh, 2), 1e-5
    elements = tet10.stiffness(mesh, MATERIAL, u, False)
    product = np.zeros_like(u)
    local = np.einsum("eij,ej->ei", elements, d[mesh.cells].reshape(-1, 30))
    np.add.at(product, mesh.cells, local.reshape(-1, 10, 3))
    expected = (
        tet10.forces(mesh, MATERIAL, u + h * d) - tet10.forces(mesh, MATERIAL, u - h * d)
    ) / (2 * h)
    assert np.abs(product - expected).max() < 1e-6 * np.abs(expected).max()


def test_projection_removes_negative_eigenvalues_only(mesh):
    u = smooth(mesh, 3)
    u[:, 0] -= 0.3 * mesh.nodes[:, 0]  # compression makes the true tangent indefinite
    true = np.linalg.eigvalsh(tet10.stiffness(mesh, MATERIAL, u, False))
    projected = np.linalg.eigvalsh(tet10.stiffness(mesh, MATERIAL, u, True))
    assert true.min() < -1e-3
    assert projected.min() > -1e-9 * projected.max()
    assert (projected >= true - 1e-9 * projected.max()).all()


def test_rigid_motion_costs_no_energy(mesh):
    turn = rotation_matrix(np.array([0.5, -1.0, 0.7]))
    u = mesh.nodes @ turn.T + [1, 2, 3] - mesh.nodes
    assert tet10.energy(mesh, MATERIAL, u) < 1e-12
    assert np.abs(tet10.forces(mesh, MATERIAL, u)).max() < 1e-9


def test_inversion_has_infinite_energy(mesh):
    assert tet10.energy(mesh, MATERIAL, -2 * mesh.nodes) == np.inf
