"""Compare solved bars with closed forms of elasticity; every tolerance has its reason."""

import numpy as np
import pytest

from defsense_fab.mechanics.elements import tet10
from defsense_fab.mechanics.elements.energy_density import stress
from defsense_fab.mechanics.elements.material import neo_hookean
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh, deformation_gradient
from defsense_fab.mechanics.loading.boundary_conditions import (
    BoundaryConditions,
    RigidHandle,
    Slide,
    State,
)
from defsense_fab.mechanics.solver.fields import deformation_gradient_at_nodes, principal_stretches
from defsense_fab.mechanics.solver.linear_response import line_forces, small_load_displacement
from defsense_fab.mechanics.solver.load_stepping import solve_ramp
from defsense_fab.mechanics.solver.newton import System
from defsense_fab.sensing.response import Response, cord_signals
from tests.conftest import structured_bar

pytestmark = pytest.mark.slow

YOUNG, NU = 0.6, 0.45
MATERIAL = neo_hookean(YOUNG / (2 * (1 + NU)), YOUNG / (3 * (1 - 2 * NU)))
SHEAR = MATERIAL.shear


def test_uniform_tension_to_twice_the_length(material):
    """With sliding faces the field is homogeneous, which the elements represent to rounding.

    The lateral stress is zero, and the force is the area times dW/dl1.
    """
    mesh = structured([0, -15, -15], [150, 15, 15], (10, 2, 2))
    x = mesh.nodes
    stretch = 2.0
    planes = tuple(
        Slide(np.flatnonzero(np.abs(x[:, a] - x[:, a].min()) < 1e-3), np.eye(3)[a])
        for a in range(3)
    )
    end = np.flatnonzero(np.abs(x[:, 0] - 150) < 1e-3)
    # Each node is a handle, so that the end face can narrow; its rim stays in the planes.
    free = np.array([[np.nan if n not in p.nodes else 0.0 for p in planes[1:]] for n in end])
    pulls = tuple(
        RigidHandle(np.array([n]), x[n], np.zeros(3), np.array([150.0, *sides]))
        for n, sides in zip(end, free, strict=True)
    )
    result = solve_ramp(
        mesh, material, BoundaryConditions(np.array([], int), pulls, planes), [1.0]
    )[-1]
    low, high = 0.4, 1.0
    for _ in range(80):
        b = (low + high) / 2
        across = stress(material, np.diag([stretch, b, b]))[1, 1]
        low, high = (b, high) if across < 0 else (low, b)
    nominal = stress(material, np.diag([stretch, b, b]))[0, 0]
    got = principal_stretches(deformation_gradient_at_nodes(mesh, result.u))
    assert np.abs(got - [stretch, b, b]).max() < 1e-6
    force = tet10.forces(mesh, material, deformation_gradient(mesh, result.u))
    start = np.abs(x[:, 0] - x[:, 0].min()) < 1e-3
    assert -force[start, 0].sum() == pytest.approx(900 * nominal, rel=1e-6)


@pytest.fixture(scope="module")
def slender():
    return structured([0, -5, -5], [150, 5, 5], (60, 4, 4))


def structured(low, high, counts):
    return QuadraticMesh.from_linear(structured_bar(low, high, counts))


def test_a_line_under_tension_deforms_a_bar_like_a_beam(slender):
    """Euler-Bernoulli; 5 % because the forces spread near the ends of the 110 mm line."""
    x, tension, off = slender.nodes, 0.01, 3.0
    path = np.stack([np.linspace(20, 130, 111), np.zeros(111), np.full(111, off)], axis=1)
    forces = line_forces(PointLocator(slender), path, tension)
    assert np.abs(forces.sum(axis=0)).max() < 1e-12
    assert np.abs(np.cross(x, forces).sum(axis=0)).max() < 1e-9
    u = small_load_displacement(slender, MATERIAL, np.flatnonzero(x[:, 0] <= 5), forces)
    bent = tension * off / (YOUNG * 10**4 / 12)
    tip = np.abs(x[:, 0] - 150) < 1e-3
    assert u[tip, 2].mean() == pytest.approx(bent * 110 * (150 - 75), rel=0.05)
    assert u[tip, 0].mean() == pytest.approx(-tension * 110 / (YOUNG * 100), rel=0.05)


def clamped(mesh, rotation):
    x = mesh.nodes
    tip = np.flatnonzero(x[:, 0] >= 145)
    handle = RigidHandle(
        tip, np.array([147.5, 0, 0]), np.array(rotation, float), np.full(3, np.nan)
    )
    return BoundaryConditions(np.flatnonzero(x[:, 0] <= 5), (handle,))


def moment(mesh, conditions, state):
    """Return the moment (3,) N mm of the forces on the tip about its center."""
    h = conditions.handles[0]
    force = tet10.forces(mesh, MATERIAL, deformation_gradient(mesh, state.u))[h.nodes]
    arm = mesh.nodes[h.nodes] + state.u[h.nodes] - h.center - state.translations[0]
    return np.cross(arm, force).sum(0)


def test_pure_bending_of_a_slender_bar(slender):
    """M = E I angle / length, and a strain of z / R.

    2 %: the free length is 140 mm at 10 mm thickness, and each clamp constrains the cross section
    within about one thickness; the angle of 0.2 keeps z / R at 0.7 %, where E is constant.
    """
    conditions = clamped(slender, [0, -0.2, 0])
    state = solve_ramp(slender, MATERIAL, conditions, [1.0])[-1].state
    assert -moment(slender, conditions, state)[1] == pytest.approx(
        YOUNG * 10**4 / 12 * 0.2 / 140, rel=0.02
    )
    x = slender.nodes
    F = deformation_gradient_at_nodes(slender, state.u)
    middle = np.abs(x[:, 0] - 75) < 30
    fibre = np.linalg.norm(F[middle, :, 0], axis=1) - 1
    slope = np.polyfit(x[middle, 2], fibre, 1)[0]
    assert abs(slope) == pytest.approx(0.2 / 140, rel=0.02)


def test_small_torsion_of_a_square_bar(slender):
    """M = G J angle / length with J = 0.1406 a^4 (Timoshenko & Goodier, sec. 109).

    2 %: the clamps constrain the warping of the sections near them.
    """
    conditions = clamped(slender, [0.2, 0, 0])
    state = solve_ramp(slender, MATERIAL, conditions, [1.0])[-1].state
    expected = SHEAR * 0.1406 * 10**4 * 0.2 / 140
    assert moment(slender, conditions, state)[0] == pytest.approx(expected, rel=0.02)


def test_bending_by_gravity(slender):
    """The tip of a cantilever sinks by w L^4 / (8 E I) + 1.2 w L^2 / (2 G A) (beam theory).

    2 %: the load is so small that the tip sinks by a hundredth of the length.
    """
    weight = 1e-8 * 100  # N/mm, of 1e-8 N/mm^3
    base = np.flatnonzero(slender.nodes[:, 0] <= 5)
    conditions = BoundaryConditions(base, gravity=np.array([0, 0, -1e-8]))
    u = solve_ramp(slender, MATERIAL, conditions, [1.0])[-1].u
    tip = np.abs(slender.nodes[:, 0] - 150) < 1e-3
    expected = weight * 145**4 / (8 * YOUNG * 10**4 / 12) + 1.2 * weight * 145**2 / (
        2 * SHEAR * 100
    )
    assert -u[tip, 2].mean() == pytest.approx(expected, rel=0.02)


def helices():
    """Return lines (6, 400, 3) that both a bend and a twist stretch."""
    s = np.linspace(0, 1, 400)
    turn = np.pi * s + np.linspace(0, 2 * np.pi, 6, endpoint=False)[:, None]
    x = np.broadcast_to(12 + 126 * s, turn.shape)
    return np.stack([x, 8 * np.cos(turn), 4 * np.sin(turn)], axis=-1)


def orders(meshes, solve, lines):
    """Fit the convergence orders of displacement and signal, with the last mesh as reference.

    Returns both orders and the errors of the second last mesh: displacement in mm, signal relative.
    `solve(mesh)` returns u (n, 3).
    """
    sizes, moved, measured = [], [], []
    for mesh in meshes:
        locator = PointLocator(mesh)
        at = locator.find(lines.reshape(-1, 3))
        moved.append(locator.displacement(at, solve(mesh)[None])[0].reshape(lines.shape))
        measured.append(cord_signals(lines, (lines + moved[-1])[None], Response.line(1.0))[0])
        sizes.append(np.cbrt(mesh.volume / len(mesh.cells)))
    off_u = [np.sqrt(((m - moved[-1]) ** 2).mean()) for m in moved[:-1]]
    off_s = [np.sqrt(((m - measured[-1]) ** 2).mean()) for m in measured[:-1]]
    x = np.log(sizes[:-1])
    left = off_u[-1], off_s[-1] / np.sqrt((measured[-1] ** 2).mean())
    return np.polyfit(x, np.log(off_u), 1)[0], np.polyfit(x, np.log(off_s), 1)[0], *left


@pytest.fixture(scope="module")
def refined():
    """Return meshes of one bar with nodes at x = 10 and 140, where its clamps end."""
    return [structured([0, -15, -7.5], [150, 15, 7.5], (15 * n, 3 * n, 2 * n)) for n in (1, 2, 3)]


def test_smooth_solutions_converge_at_the_rate_of_quadratic_elements(refined):
    """The surface is prescribed on a smooth curve: orders h^3 and at least h^2."""

    def solve(mesh):
        x = mesh.nodes
        radius = 150 / 0.8
        turn, arm = x[:, 0] / radius, radius - x[:, 2]
        u = np.stack([arm * np.sin(turn), x[:, 1], radius - arm * np.cos(turn)], 1) - x
        u[:, 1] += 1.5 * np.sin(np.pi * x[:, 0] / 75)
        conditions = BoundaryConditions(np.unique(tet10.boundary_faces(mesh)))
        system = System(mesh, MATERIAL, conditions, threads=2)
        start = State(u, np.zeros((0, 3, 3)), np.zeros((0, 3)), conditions)
        attempt = system.equilibrium(start)
        system.close()
        return attempt.state.u

    displacement, signal, off, relative = orders(refined, solve, helices())
    assert displacement > 2.5
    assert signal > 1.9
    assert off < 2e-3
    assert relative < 3e-3


@pytest.mark.parametrize("rotation", [[0, -np.pi / 3, 0], [np.pi / 3, 0, 0]], ids=["bend", "twist"])
def test_clamped_poses_converge(refined, rotation):
    """The stress is singular at the edges of the clamps, which lowers the orders."""

    def solve(mesh):
        x = mesh.nodes
        tip = np.flatnonzero(x[:, 0] >= 140 - 1e-6)
        handle = RigidHandle(tip, np.array([145.0, 0, 0]), np.array(rotation), np.full(3, np.nan))
        goal = BoundaryConditions(np.flatnonzero(x[:, 0] <= 10 + 1e-6), (handle,))
        return solve_ramp(mesh, MATERIAL, goal, [1.0], threads=2)[-1].u

    displacement, signal, off, relative = orders(refined, solve, helices())
    assert displacement > 1.0
    assert signal > 1.0
    assert off < 0.1
    assert relative < 0.015
