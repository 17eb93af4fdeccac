"""Compare the forces that hold a pose with beam theory, and with the derivative of the energy."""

import numpy as np
import pytest

from defsense_fab.core.device.device import PointDrag
from defsense_fab.mechanics.elements.material import neo_hookean
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.loading.boundary_conditions import BoundaryConditions, RigidHandle
from defsense_fab.mechanics.loading.fibers import Fibers
from defsense_fab.mechanics.solver.batch import Job, solve_all
from defsense_fab.mechanics.solver.reactions import find_reactions
from tests.support.grid import grid_of_tets

YOUNG, NU, LENGTH, SIDE = 2.0, 0.3, 200.0, 10.0
MATERIAL = neo_hookean(YOUNG / (2 * (1 + NU)), YOUNG / (3 * (1 - 2 * NU)))
BENDING = YOUNG * SIDE**4 / 12
TORSION = YOUNG / (2 * (1 + NU)) * 0.1406 * SIDE**4  # of a square (Timoshenko & Goodier 1970)
FREE = np.full(3, np.nan)
NONE = np.zeros(3)
NO_AXES = np.zeros((0, 3))


@pytest.fixture(scope="module")
def slender():
    across = np.linspace(-SIDE / 2, SIDE / 2, 4)
    return QuadraticMesh.from_linear(grid_of_tets([np.linspace(0, LENGTH, 41), across, across]))


@pytest.fixture(scope="module")
def short():
    across = np.linspace(-SIDE / 2, SIDE / 2, 3)
    return QuadraticMesh.from_linear(grid_of_tets([np.linspace(0, 40.0, 6), across, across]))


def held(mesh, rotation=NONE, translation=NONE, axes=NO_AXES, **more):
    """Return conditions of a bar along x: the first face held, the last one moved."""
    x = mesh.nodes
    end = np.flatnonzero(x[:, 0] > x[:, 0].max() - 1e-6)
    center = x[end].mean(axis=0)
    tip = RigidHandle(end, center, np.array(rotation), np.array(translation), axes, "tip")
    return BoundaryConditions(np.flatnonzero(x[:, 0] < 1e-6), (tip,), **more)


def react(mesh, conditions, fractions=(0.5, 1.0)):
    """Return the reactions at the last of the fractions."""
    results = solve_all(mesh, MATERIAL, [Job(conditions, fractions)], threads=1)[0]
    before = results[-2].u if len(results) > 1 else np.zeros_like(mesh.nodes)
    step = np.diff((0.0, *fractions))[-1]
    fields = (results[-1].u, before)
    return find_reactions(mesh, MATERIAL, conditions, fractions[-1], fields, step)


def test_a_couple_bends_a_slender_bar(slender):
    """M = E I angle / L. A couple M does the work of a force 2 M / L at the end, since the end of a
    circular arc moves by angle L / 2. The held faces stiffen the ends, by less than 1 %.
    """
    angle = np.deg2rad(4)
    (tip,) = react(slender, held(slender, [0, angle, 0], FREE))
    moment = BENDING * angle / LENGTH
    assert np.abs(tip.force).max() < 1e-4 * moment / LENGTH
    assert tip.moment == pytest.approx([0, moment, 0], rel=0.01, abs=1e-3 * moment)
    assert tip.power == pytest.approx(moment * angle, rel=0.01)
    assert tip.push == pytest.approx(2 * moment / LENGTH, rel=0.01)


def test_traces_stiffen_a_slender_bar_like_a_composite_beam(slender):
    """The stiffness of two traces at +-h adds 2 (E_trace - E) (A h^2 + I_trace) to E I."""
    width, height, trace, at = 1.2, 0.8, 40.0, 3.0
    fibers = [
        Fibers.of_trace(
            np.array([[0.0, 0.1, z], [LENGTH, 0.1, z]]),
            (width, height),
            np.array([0.0, 0.0, 1.0]),
            (trace, YOUNG),
            poisson=NU,
        )
        for z in (-at, at)
    ]
    angle = np.deg2rad(4)
    conditions = held(slender, [0, angle, 0], FREE, fibers=fibers[0] + fibers[1])
    (tip,) = react(slender, conditions)
    added = 2 * (trace - YOUNG) * (width * height * at**2 + width * height**3 / 12)
    assert tip.moment[1] == pytest.approx((BENDING + added) * angle / LENGTH, rel=0.02)
    assert added > 0.3 * BENDING


def test_a_force_bends_a_slender_bar(slender):
    """F = 3 E I d / L^3 where the end may turn; shear adds 0.2 % of compliance."""
    tip = react(slender, held(slender, NONE, [np.nan, 0, 4.0], np.eye(3)[1:2]))[0]
    force = 3 * BENDING * 4.0 / LENGTH**3
    assert tip.force == pytest.approx([0, 0, force], rel=0.01, abs=1e-3 * force)
    assert tip.moment[1] == pytest.approx(0, abs=1e-3 * force * LENGTH)
    assert tip.push == pytest.approx(force, rel=0.01)


def test_a_torque_twists_and_a_force_stretches(slender):
    """T = G J angle / L and F = E A d / L; held faces cannot warp, which stiffens by about 1 %."""
    angle = np.deg2rad(20)
    tip = react(slender, held(slender, [angle, 0, 0], FREE))[0]
    torque = TORSION * angle / LENGTH
    assert tip.moment == pytest.approx([torque, 0, 0], rel=0.02, abs=1e-3 * torque)
    # The square's radius of gyration is side / sqrt(6); the region's nodes are those of the mesh.
    assert tip.push == pytest.approx(torque / (SIDE / np.sqrt(6)), rel=0.1)
    pull = react(slender, held(slender, NONE, [0.2, 0, 0]))[0]
    force = YOUNG * SIDE**2 * 0.2 / LENGTH
    assert pull.force == pytest.approx([force, 0, 0], rel=0.01, abs=1e-3 * force)
    assert pull.push == pytest.approx(force, rel=0.01)


def _energy_slope(mesh, conditions, at, step=0.01):
    """Return the derivative of the energy by the amplitude, by central differences, N mm."""
    fractions = (at - step, at + step)
    results = solve_all(mesh, MATERIAL, [Job(conditions, fractions)], threads=1)[0]
    low, high = (r.statistics.energy for r in results)
    return (high - low) / (2 * step)


@pytest.mark.parametrize("about", [(40.0, 0, 0), (20.0, 5, -3)])
@pytest.mark.parametrize("has_fibers", [False, True])
def test_power_is_the_derivative_of_the_energy(short, about, has_fibers):
    """For a large turn about any pivot, with a prescribed and a free translation, and fibers."""
    conditions = held(short, [0.3, 0.8, 0], [2.0, np.nan, -3.0])
    tip = RigidHandle(**{**vars(conditions.handles[0]), "center": np.array(about)})
    fibers = None
    if has_fibers:
        line = np.array([[1.0, 2.1, 2.2], [39.0, 2.1, 2.2]])
        fibers = Fibers.of_trace(line, (1.2, 0.8), np.array([0, 0, 1.0]), (50.0, YOUNG))
    conditions = BoundaryConditions(conditions.fixed, (tip,), fibers=fibers)
    power = react(short, conditions, (0.4, 0.8))[0].power
    assert power == pytest.approx(_energy_slope(short, conditions, 0.8), rel=1e-3)


def test_a_drag_is_a_force_along_its_movement(short):
    drag = PointDrag(np.array([40.0, 0, 0]), np.array([0, 0, 6.0]), 0.5)
    conditions = BoundaryConditions(np.flatnonzero(short.nodes[:, 0] < 1e-6), drags=(drag,))
    (pull,) = react(short, conditions)
    assert pull.power == pytest.approx(_energy_slope(short, conditions, 1.0), rel=1e-3)
    assert pull.push == pytest.approx(pull.force[2])
    assert 0 < pull.push < 3.0


def test_what_only_holds_has_no_reaction(short):
    """A handle that may move freely, and gravity, push nothing."""
    conditions = held(short, NONE, FREE, np.eye(3), gravity=np.array([0, 0, -1e-5]))
    assert react(short, conditions) == ()
