"""Check fields at points, gradients, stretches, the interactive solver and modes."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.mechanics.elements.material import neo_hookean
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.loading.boundary_conditions import BoundaryConditions, RigidHandle
from defsense_fab.mechanics.solver.fields import (
    deformation_gradient_at_nodes,
    principal_stretches,
    stretch_along,
)
from defsense_fab.mechanics.solver.interactive import VISUAL_TOLERANCE, InteractiveSolver
from defsense_fab.mechanics.solver.linear_response import (
    _mirror_axes,
    _snap_to_mirror,
    propose_poses,
    vibration_modes,
)
from defsense_fab.mechanics.solver.load_stepping import Status, solve_ramp
from defsense_fab.mechanics.solver.newton import TOLERANCE
from tests.conftest import structured_bar

MATERIAL = neo_hookean(0.2, 5.0)


def test_quadratic_fields_are_read_exactly(mesh):
    """Values and gradients of a quadratic field are exact to rounding at all points inside."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(3, 3, 3)) * 1e-3
    u = np.einsum("aij,ni,nj->na", A, mesh.nodes, mesh.nodes)
    points = rng.uniform([0.5, -14.5, -14.5], [149.5, 14.5, 14.5], (20_000, 3))
    locator = PointLocator(mesh)
    at = locator.find(points)
    assert at.depth.min() > -1e-9
    assert locator.displacement(at, u[None])[0] == pytest.approx(
        np.einsum("aij,ni,nj->na", A, points, points), abs=1e-8
    )
    gradient = np.einsum("aij,nj->nai", A + A.transpose(0, 2, 1), points)
    assert locator.gradient(at, u[None])[0] == pytest.approx(gradient, abs=1e-8)


def test_points_outside_use_the_nearest_tet(mesh):
    at = PointLocator(mesh).find(np.array([[150.4, 0, 0], [75, 0, 15.3]]))
    assert (at.depth < 0).all()
    assert (at.depth > -0.5).all()


def test_stretches_of_a_known_gradient(mesh):
    G = np.array([[0.2, 0.1, 0], [0, -0.1, 0], [0, 0, 0.05]])
    F = deformation_gradient_at_nodes(mesh, mesh.nodes @ G.T)
    assert pytest.approx(np.broadcast_to(np.eye(3) + G, F.shape), abs=1e-9) == F
    s = np.linalg.svd(np.eye(3) + G, compute_uv=False)
    assert principal_stretches(F) == pytest.approx(np.broadcast_to(s, (len(F), 3)), abs=1e-9)
    d = np.array([0, 2.0, 0])
    assert stretch_along(F, d)[0] == pytest.approx(np.hypot(0.1, 0.9))


@pytest.fixture(scope="module")
def meshes():
    """Return a coarse and a fine mesh of one bar."""
    counts = (8, 2, 2), (15, 3, 3)
    bars = (structured_bar([0, -15, -15], [150, 15, 15], n) for n in counts)
    return tuple(map(QuadraticMesh.from_linear, bars))


def test_an_edit_gives_the_coarse_answer_first_then_the_fine_one(clamp, meshes):
    session = InteractiveSolver(*meshes, MATERIAL)
    for degrees in (30, 40, 35):
        answers = []
        goal = [0, -np.deg2rad(degrees), 0]
        result = session.edit(lambda m, goal=goal: clamp(m, goal), answers.append)
        assert result.status == Status.OK
        direct = solve_ramp(meshes[1], MATERIAL, clamp(meshes[1], goal), [1.0])[-1].u
        assert np.abs(result.u - direct).max() < 1e-4
        assert np.abs(answers[0] - direct).max() < 0.06 * np.abs(direct).max()
    before = session.displacements[1]
    stopped = session.edit(lambda m: clamp(m, [1.0, 0, 0]), stop=lambda: True)
    assert stopped.status == Status.CANCELLED
    assert session.displacements[1] is before
    answers = []
    newer = session.edit(lambda m: clamp(m, [1.0, 0, 0]), answers.append, newer=lambda: True)
    assert newer.status == Status.CANCELLED
    assert len(answers) == 1  # the coarse answer still follows the user
    assert session.displacements[1] is before
    session.close()


def test_the_visual_tolerance_is_faster_and_accurate_enough(clamp, meshes):

    def bent(degrees):
        return lambda mesh: clamp(mesh, [0, -np.deg2rad(degrees), 0])

    solved = {}
    for tolerance in (TOLERANCE, VISUAL_TOLERANCE):
        session = InteractiveSolver(*meshes, MATERIAL)
        session.edit(bent(30))
        solved[tolerance] = session.edit(bent(33), check=False, tolerance=tolerance)
        session.close()
    exact, quick = solved[TOLERANCE], solved[VISUAL_TOLERANCE]
    assert quick.statistics.iterations < exact.statistics.iterations
    assert np.abs(quick.u - exact.u).max() < 1e-3


@pytest.mark.slow
def test_an_unreached_edit_reports_its_amplitude(clamp, meshes):
    """The failed pose is solved from rest, and the last pose remains the start of the next."""

    def pushed(x):
        return lambda mesh: clamp(mesh, translation=[x, 0, 0])

    session = InteractiveSolver(*meshes, MATERIAL)
    before = session.edit(pushed(-15.0)).u
    failed = session.edit(pushed(-400.0))
    assert failed.status == Status.NOT_REACHED
    alone = solve_ramp(meshes[1], MATERIAL, pushed(-400.0)(meshes[1]), [1.0])[-1]
    assert failed.amplitude == pytest.approx(alone.amplitude, abs=0.05)
    assert session.displacements[1] is before
    after = session.edit(pushed(-14.0))
    direct = solve_ramp(meshes[1], MATERIAL, pushed(-14.0)(meshes[1]), [1.0])[-1].u
    assert np.abs(after.u - direct).max() < 1e-4
    session.close()


@pytest.fixture(scope="module")
def bar_modes():
    mesh = QuadraticMesh.from_linear(structured_bar([0, -15, -15], [150, 15, 15], (20, 4, 4)))
    fixed = np.flatnonzero(mesh.nodes[:, 0] < 1e-3)
    young, nu = 0.6, 0.45
    law = neo_hookean(young / (2 * (1 + nu)), young / (3 * (1 - 2 * nu)))
    return mesh, fixed, vibration_modes(mesh, law, fixed, 1.1, 6)


def test_modes_of_a_bar_have_the_frequencies_of_beam_theory(bar_modes):
    """Two bends, a twist and a stretch, within 4 %.

    A bar five times as long as thick is not a slender beam: shear and rotary inertia lower the
    frequencies of its bends, and the clamp constrains the cross section.
    """
    length, side, c = 150.0, 30.0, np.sqrt(0.6 / 1.1e-9)
    bend = 3.516 / (2 * np.pi) * side / np.sqrt(12) / length**2 * c
    twist = np.sqrt(0.1406 * 6 / (2 * 1.45)) * c / (4 * length)
    stretch = c / (4 * length)
    assert bend < twist < stretch
    _, _, found = bar_modes
    first = [m for m in found if m.order == 1]
    assert [m.kind for m in first] == ["bend", "bend", "twist", "stretch"]
    assert [m.frequency for m in first] == pytest.approx([bend, bend, twist, stretch], rel=0.04)
    assert [m.frequency for m in found] == sorted(m.frequency for m in found)
    assert [m.kind for m in found if m.order == 2] == ["bend", "bend"]


def test_modes_are_proposed_as_poses(bar_modes):
    mesh, fixed, found = bar_modes
    poses = propose_poses(mesh, fixed, found)
    assert [p.name for p in poses] == ["bend", "bend_2", "twist", "stretch"]
    first, second, twist, stretch = poses
    assert abs(first.rotation @ second.rotation) < 1e-9  # about different axes
    assert {int(np.abs(p.rotation).argmax()) for p in (first, second)} == {1, 2}
    assert np.abs(twist.rotation) == pytest.approx([np.pi / 6, 0, 0])
    assert stretch.translation[0] > 10
    assert np.isnan(first.translation).all()
    beyond = (mesh.nodes - first.origin) @ first.axis >= 0
    result = solve_ramp(
        mesh,
        MATERIAL,
        BoundaryConditions(fixed, (_handle(mesh, beyond, first),)),
        [1.0],
    )[-1]
    assert result.status == Status.OK


def test_poses_follow_the_symmetry_of_the_body_not_of_its_mesh(bar_mesh):
    """A square bar of unstructured tets bends about its axes; a skewed bar does not."""
    mesh = QuadraticMesh.from_linear(bar_mesh)
    assert [axis.tolist() for axis in _mirror_axes(mesh)] == np.eye(3).tolist()
    fixed = np.flatnonzero(mesh.nodes[:, 0] < 8)
    found = propose_poses(mesh, fixed, vibration_modes(mesh, MATERIAL, fixed, 1.2, 3))
    bends = [p.rotation / np.linalg.norm(p.rotation) for p in found if p.mode.kind == "bend"]
    assert len(bends) == 2
    assert {tuple(np.abs(axis)) for axis in bends} == {(0, 1, 0), (0, 0, 1)}
    skewed = replace(bar_mesh, nodes=bar_mesh.nodes @ [[1, 0, 0], [0, 1, 0], [0, 0.4, 1]])
    assert [a.tolist() for a in _mirror_axes(QuadraticMesh.from_linear(skewed))] == [[1, 0, 0]]
    assert _snap_to_mirror(np.array([0, np.cos(0.3), np.sin(0.3)]), list(np.eye(3)))[2] > 0.2


def _handle(mesh, inside, pose):
    nodes = np.flatnonzero(inside)
    return RigidHandle(nodes, mesh.nodes[nodes].mean(0), pose.rotation, pose.translation)
