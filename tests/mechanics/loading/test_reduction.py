"""Check the reduced gradient and Hessian by finite differences, and loads."""

import numpy as np
import pytest

from defsense_fab.core.device.device import PointDrag
from defsense_fab.core.rotations import rotation_matrices
from defsense_fab.mechanics.elements import tet10
from defsense_fab.mechanics.loading.boundary_conditions import (
    BoundaryConditions,
    Pressure,
    Slide,
    interpolate_conditions,
    rest_state,
)
from defsense_fab.mechanics.loading.loads import Loads
from defsense_fab.mechanics.loading.reduction import Reduction
from tests.mechanics.conftest import MODELS

MATERIAL = MODELS["neo-hookean"]

CASES = {
    "free translation": {},
    "one free translation": {"translation": [np.nan, 2.0, 0.0]},
    "free rotation": {"translation": [3.0, 0, 0], "free_axes": np.eye(3)},
    "hinge": {"translation": [np.nan, 1, 0], "free_axes": [[0, 0.6, 0.8]]},
    "all free": {"free_axes": np.eye(3)},
}


def full(upper):
    dense = upper.toarray()
    return dense + np.triu(dense, 1).T


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_gradient_and_hessian_by_finite_differences(mesh, clamp, case):
    """Along random directions of the unknowns, handles turn by the exponential map."""
    slides = (Slide(np.flatnonzero(np.abs(mesh.nodes[:, 1] + 15) < 1e-6), np.array([0, 1.0, 0])),)
    drags = (PointDrag(np.array([80.0, 3, 4]), np.array([0, 1.0, 2]), 0.3),)
    turned = "free_axes" in case or "translation" in case
    conditions = clamp(
        mesh, slides=() if turned else slides, drags=drags, gravity=np.array([0, 0, -1e-5]), **case
    )
    reduction, loads = Reduction(mesh, conditions), Loads(mesh, conditions)
    rng = np.random.default_rng(0)
    start = reduction.place(rest_state(conditions, len(mesh.nodes)), conditions)
    state = reduction.move(start, rng.normal(0, 0.05, reduction.size))
    none = np.zeros_like(state.u)

    def value(s):
        F = tet10.deformation_gradient(reduction.active, s.u)
        inner = tet10.energy(reduction.active, MATERIAL, F)
        return inner + loads.energy(s.conditions, s.u, none)

    def force(s):
        F = tet10.deformation_gradient(reduction.active, s.u)
        inner = tet10.forces(reduction.active, MATERIAL, F)
        return inner - loads.forces(s.conditions, s.u, none)

    gradient = reduction.gradient(state, force(state))
    F = tet10.deformation_gradient(reduction.active, state.u)
    blocks = loads.blocks(conditions, state.u)
    hessian = full(reduction.matrix(state, MATERIAL, F, False, blocks, force(state)))
    h = 1e-4
    steps = np.array([-2, -1, 0, 1, 2])
    for _ in range(4):
        d = rng.normal(size=reduction.size)
        values = np.array([value(reduction.move(state, s * h * d)) for s in steps])
        # Fourth order: all nodes of a random mesh move, and its thinnest tets are far from linear.
        slope = values @ [1, -8, 0, 8, -1] / (12 * h)
        assert slope == pytest.approx(gradient @ d, rel=1e-6)
        curvature = values @ [-1, 16, -30, 16, -1] / (12 * h**2)
        assert curvature == pytest.approx(d @ hessian @ d, rel=1e-3)
    rotations = reduction.dof[conditions.handles[0].nodes[0], 3:]
    for i in rotations[rotations >= 0]:  # the few that the second derivatives are about
        d = np.zeros(reduction.size)
        d[i] = 1.0
        up, down = (value(reduction.move(state, s * 1e-3 * d)) for s in (1, -1))
        assert (up - 2 * value(state) + down) / 1e-6 == pytest.approx(hessian[i, i], rel=1e-3)


@pytest.mark.slow
def test_threads_do_not_change_the_matrix(mesh, clamp):
    conditions = clamp(mesh)
    reduction = Reduction(mesh, conditions)
    state = rest_state(conditions, len(mesh.nodes))
    F = tet10.deformation_gradient(reduction.active, state.u)
    one, two = (reduction.matrix(state, MATERIAL, F, True, [], None, threads) for threads in (1, 2))
    assert two.data == pytest.approx(one.data, rel=1e-12, abs=1e-12)


def test_sliding_nodes_stay_in_their_planes(mesh):
    x = mesh.nodes
    n = np.array([0, 0.6, 0.8])
    slides = (
        Slide(np.arange(0, 200), n),
        Slide(np.arange(100, 200), np.array([1.0, 0, 0])),
        Slide(np.arange(150, 200), np.array([0, 0.8, -0.6])),
    )
    conditions = BoundaryConditions(np.arange(300, 310), (), slides)
    reduction = Reduction(mesh, conditions)
    q = np.random.default_rng(0).normal(size=reduction.size)
    u = reduction.move(rest_state(conditions, len(x)), q).u
    assert np.abs(u[:200] @ n).max() < 1e-12
    assert np.abs(u[100:200, 0]).max() < 1e-12
    assert np.abs(u[150:200]).max() < 1e-12  # three planes: a fixed point
    assert (u[300:310] == 0).all()
    assert reduction.size == 3 * (len(x) - 210) + 2 * 100 + 50


def test_pressure_is_the_derivative_of_the_enclosed_volume(mesh):
    """On a closed surface the follower load is conservative: -p dV, and its tangent symmetric."""
    faces = tet10.boundary_faces(mesh)
    conditions = BoundaryConditions(np.array([0]), pressures=(Pressure(faces, 0.3),))
    loads = Loads(mesh, conditions)
    rng = np.random.default_rng(1)
    u, d = (0.5 * np.sin(mesh.nodes @ rng.normal(0, 0.05, (3, 3))) for _ in range(2))

    def volume(u):
        F = tet10.deformation_gradient(mesh, u)
        return (np.linalg.det(F) * mesh.weight[:, None]).sum()

    h = 1e-4
    change = (volume(u + h * d) - volume(u - h * d)) / (2 * h)
    force = loads.pressure(conditions, u)
    assert (force * d).sum() == pytest.approx(-0.3 * change, rel=1e-3)
    slope = (loads.pressure(conditions, u + h * d) - loads.pressure(conditions, u - h * d)) / (
        2 * h
    )
    product = np.zeros_like(u)
    for nodes, block in loads.blocks(conditions, u):
        product[nodes] += (block @ d[nodes].ravel()).reshape(-1, 3)
    assert product == pytest.approx(-slope, abs=1e-6 * np.abs(slope).max())


def test_gravity_carries_the_weight(mesh, clamp):
    conditions = clamp(mesh, gravity=np.array([0, 0, -2e-5]))
    force = Loads(mesh, conditions).forces(conditions, 0 * mesh.nodes, 0 * mesh.nodes)
    assert force.sum(0) == pytest.approx([0, 0, -2e-5 * mesh.volume])


def test_rotation_vectors_do_not_wrap(mesh, clamp):
    goal = clamp(mesh, [1.5 * np.pi, 0, 0])
    half = interpolate_conditions(goal.at_rest(), goal, 0.5).handles[0].rotation
    assert half == pytest.approx([0.75 * np.pi, 0, 0])
    vector = np.array([0.3, -2.0, 1.0])
    turn = rotation_matrices(vector)
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert rotation_matrices(np.zeros((2, 3))) == pytest.approx(np.stack([np.eye(3)] * 2))
    assert turn @ vector == pytest.approx(vector)
    assert np.trace(turn) == pytest.approx(1 + 2 * np.cos(np.linalg.norm(vector)))
