"""Check energy, forces and tangent of a mesh against each other, and their invariances."""

import numpy as np
import pytest

from defsense_fab.core.rotations import rotation_matrices
from defsense_fab.mechanics.elements import tet10
from defsense_fab.mechanics.elements.tet10 import boundary_faces, deformation_gradient


def smooth(mesh, seed):
    """Return a smooth random displacement."""
    rng = np.random.default_rng(seed)
    return 0.5 * np.sin(mesh.nodes @ rng.normal(0, 0.1, (3, 3))) @ rng.normal(size=(3, 3))


def energy(mesh, material, u, threads=1):
    return tet10.energy(mesh, material, deformation_gradient(mesh, u, threads), threads)


def forces(mesh, material, u, threads=1):
    return tet10.forces(mesh, material, deformation_gradient(mesh, u, threads), threads)


def stiffness(mesh, material, u, share, threads=1):
    F = deformation_gradient(mesh, u, threads)
    return tet10.stiffness(mesh, material, F, share, threads)


def test_forces_are_the_gradient_of_the_energy(mesh, material):
    u, d, h = smooth(mesh, 1), smooth(mesh, 2), 1e-5
    slope = (energy(mesh, material, u + h * d) - energy(mesh, material, u - h * d)) / (2 * h)
    assert slope == pytest.approx((forces(mesh, material, u) * d).sum(), rel=1e-6)


def test_tangent_is_the_gradient_of_the_forces(mesh, material):
    u, d, h = smooth(mesh, 1), smooth(mesh, 2), 1e-5
    elements = stiffness(mesh, material, u, 0.0)
    local = np.einsum("eij,ej->ei", elements, d[mesh.cells].reshape(-1, 30))
    product = tet10.scatter_nodes(mesh, local.reshape(-1, 10, 3))
    expected = (forces(mesh, material, u + h * d) - forces(mesh, material, u - h * d)) / (2 * h)
    assert np.abs(product - expected).max() < 1e-6 * np.abs(expected).max()


def test_projection_removes_negative_eigenvalues_only(mesh, material):
    u = smooth(mesh, 3)
    u[:, 0] -= 0.3 * mesh.nodes[:, 0]  # compression makes the true tangent indefinite
    true = np.linalg.eigvalsh(stiffness(mesh, material, u, 0.0))
    projected = np.linalg.eigvalsh(stiffness(mesh, material, u, 1.0))
    assert true.min() < -1e-3
    assert projected.min() > -1e-9 * projected.max()
    assert (projected >= true - 1e-9 * projected.max()).all()


def test_linearized_forces_match_the_tangent(mesh, material):
    """At the state itself they are the forces; away from it they grow by the projected tangent."""
    u, d = smooth(mesh, 1), smooth(mesh, 2)
    G = deformation_gradient(mesh, u)
    at = tet10.linearized_forces(mesh, material, G, G)
    assert at == pytest.approx(forces(mesh, material, u), abs=1e-10)
    away = tet10.linearized_forces(mesh, material, G, deformation_gradient(mesh, u + d)) - at
    elements = stiffness(mesh, material, u, 1.0)
    local = np.einsum("eij,ej->ei", elements, d[mesh.cells].reshape(-1, 30))
    expected = tet10.scatter_nodes(mesh, local.reshape(-1, 10, 3))
    assert away == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_volume_is_exact_at_the_state_and_first_order_about_it(mesh):
    u, d = smooth(mesh, 1), smooth(mesh, 2)
    G = deformation_gradient(mesh, u)
    assert tet10.volume_ratios(G, G) == pytest.approx(np.linalg.det(G))
    off = [
        np.abs(tet10.volume_ratios(G, F) - np.linalg.det(F)).max()
        for F in (deformation_gradient(mesh, u + h * d) for h in (1e-2, 1e-3))
    ]
    assert off[0] / off[1] == pytest.approx(100, rel=0.1)
    assert (tet10.volume_ratios(G, G, 3) == tet10.volume_ratios(G, G)).all()


def test_pressure_forces_are_the_gradient_of_the_volume(mesh):
    u, d, h = smooth(mesh, 1), smooth(mesh, 2), 1e-5

    def volumes(u):
        F = deformation_gradient(mesh, u)
        return tet10.volume_ratios(F, F) * mesh.weight[:, None]

    pressure = np.random.default_rng(0).normal(size=(len(mesh.cells), 4))
    found = (tet10.pressure_forces(mesh, pressure, deformation_gradient(mesh, u)) * d).sum()
    slope = (pressure * (volumes(u + h * d) - volumes(u - h * d))).sum() / (2 * h)
    assert found == pytest.approx(slope, rel=1e-6)


def test_rigid_motion_costs_no_energy(mesh, material):
    turn = rotation_matrices(np.array([0.5, -1.0, 0.7]))
    u = mesh.nodes @ turn.T + [1, 2, 3] - mesh.nodes
    assert energy(mesh, material, u) < 1e-8
    assert np.abs(forces(mesh, material, u)).max() < 1e-8


def test_forces_rotate_with_the_body(mesh, material):
    turn = rotation_matrices(np.array([0.5, -1.0, 0.7]))
    u = smooth(mesh, 4)
    turned = (mesh.nodes + u) @ turn.T - mesh.nodes
    expected = forces(mesh, material, u) @ turn.T
    assert forces(mesh, material, turned) == pytest.approx(expected, abs=1e-8)


def test_threads_do_not_change_the_result(mesh, material):
    u = smooth(mesh, 1)
    assert energy(mesh, material, u, 3) == pytest.approx(energy(mesh, material, u), rel=1e-12)
    assert (forces(mesh, material, u, 3) == forces(mesh, material, u)).all()
    assert (stiffness(mesh, material, u, 1.0, 3) == stiffness(mesh, material, u, 1.0)).all()


def test_boundary_faces_enclose_the_volume(mesh):
    faces = boundary_faces(mesh)
    a, b, c = (mesh.nodes[faces[:, i]] for i in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(mesh.volume)
    for k, (i, j) in enumerate(((0, 1), (1, 2), (2, 0))):
        middle = (mesh.nodes[faces[:, i]] + mesh.nodes[faces[:, j]]) / 2
        assert mesh.nodes[faces[:, 3 + k]] == pytest.approx(middle)
