"""Check fibers by finite differences, rigid motions, closed forms and convergence."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import SolveError
from defsense_fab.core.rotations import rotation_matrices
from defsense_fab.mechanics.elements.material import neo_hookean
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.loading.boundary_conditions import BoundaryConditions, RigidHandle
from defsense_fab.mechanics.loading.fibers import EmbeddedFibers, Fibers
from defsense_fab.mechanics.loading.loads import Loads
from defsense_fab.mechanics.solver.load_stepping import Status, solve_ramp
from tests.support.grid import grid_of_tets

X = np.linspace(1, 39, 40)
WAVE = np.stack([X, 2 * np.sin(X / 5), 1.5 * np.cos(X / 7)], axis=1)
STRAIGHT = np.array([[0.0, 0.5, 1.2], [40.0, 0.5, 1.2]])


@pytest.fixture(scope="module")
def block():
    """A block of 40 x 10 x 6 mm."""
    axes = (np.linspace(0, 40, 9), np.linspace(-5, 5, 4), np.linspace(-3, 3, 3))
    return QuadraticMesh.from_linear(grid_of_tets(axes))


@pytest.fixture(params=["neo-hookean", "linear", "shear"])
def embedded(block, request):
    lines, stiffness = (WAVE, STRAIGHT), np.array([3.0, 5.0])
    fibers = Fibers(lines, stiffness, request.param == "linear")
    if request.param == "shear":
        normals = np.array([[0, 0, 1.0], [0, 0.6, 0.8]])
        fibers = replace(fibers, shear=np.array([[2.0, 1], [3, 4]]), normals=normals)
    return EmbeddedFibers(block, fibers)


@pytest.fixture
def field(block):
    """A smooth displacement field that stretches some points, and compresses others."""
    rng = np.random.default_rng(2)
    return 1.5 * np.sin(block.nodes @ rng.normal(0, 0.12, (3, 3)) + rng.normal(size=3))


def multiply(embedded, blocks, d):
    out = np.zeros_like(d)
    np.add.at(
        out, embedded.nodes, (blocks @ d[embedded.nodes].reshape(-1, 30, 1)).reshape(-1, 10, 3)
    )
    return out


def directions(block):
    rng = np.random.default_rng(3)
    return rng.normal(size=(4, *block.nodes.shape))


def test_forces_are_the_gradient_of_the_energy(block, embedded, field):
    force = embedded.forces(embedded.vectors(field))
    for d in directions(block):
        up, down = (embedded.energy(embedded.vectors(field + s * 1e-5 * d)) for s in (1, -1))
        assert (up - down) / 2e-5 == pytest.approx((force * d).sum(), rel=1e-7)


def test_tangent_is_the_gradient_of_the_forces(block, embedded, field):
    blocks = embedded.tangents(embedded.vectors(field))
    for d in directions(block):
        up, down = (embedded.forces(embedded.vectors(field + s * 1e-5 * d)) for s in (1, -1))
        expected = (up - down) / 2e-5
        assert multiply(embedded, blocks, d) == pytest.approx(
            expected, abs=1e-6 * np.abs(expected).max()
        )


def test_projected_tangent_is_positive_semidefinite(embedded, field):
    vectors = embedded.vectors(field)
    assert (np.linalg.norm(vectors[:, :, 0], axis=1) < 1).any()
    smallest = [np.linalg.eigvalsh(embedded.tangents(vectors, s)).min() for s in (0.0, 0.5, 1.0)]
    assert smallest[0] < smallest[1] < -1e-4
    assert smallest[2] > -1e-9


def test_linearized_forces_follow_the_projected_tangent(block, embedded, field):
    about = embedded.vectors(0.3 * field)
    step = 0.2 * directions(block)[0]
    expected = embedded.forces(about) + multiply(embedded, embedded.tangents(about, 1.0), step)
    linear = embedded.linearized_forces(about, embedded.vectors(0.3 * field + step))
    assert linear == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_rigid_motions_cause_no_force(block, embedded):
    turn = rotation_matrices(np.array([1.0, -0.7, 2.0]))
    u = block.nodes @ turn.T + np.array([3.0, -20, 1]) - block.nodes
    vectors = embedded.vectors(u)
    assert embedded.energy(vectors) == pytest.approx(0, abs=1e-20)
    assert embedded.forces(vectors) == pytest.approx(np.zeros_like(u), abs=1e-10)


@pytest.mark.parametrize(
    ("is_linear", "expected"), [(True, 0.2), (False, (1.2 - 1 / 1.44) / 3)], ids=["linear", "neo"]
)
def test_straight_fiber_in_a_stretched_block(block, is_linear, expected):
    embedded = EmbeddedFibers(block, Fibers((STRAIGHT,), np.array([7.0]), is_linear))
    force = embedded.forces(embedded.vectors(block.nodes * [0.2, 0.0, 0.0]))
    assert force.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    assert (force * block.nodes).sum() == pytest.approx(7.0 * expected * 40)  # virtual work
    end = np.abs(block.nodes[:, 0] - 40) < 1e-9
    assert force[end, 0].sum() == pytest.approx(7.0 * expected)


def test_shear_of_the_cross_section(block):
    normals, shear = np.array([[0, 0, 1.0]]), np.array([[3.0, 5.0]])
    embedded = EmbeddedFibers(block, Fibers((STRAIGHT,), np.zeros(1), False, shear, normals))
    for axis, stiffness in ((1, 3.0), (2, 5.0)):
        u = np.zeros_like(block.nodes)
        u[:, 0] = 0.1 * block.nodes[:, axis]
        assert embedded.energy(embedded.vectors(u)) == pytest.approx(0.5 * stiffness * 0.01 * 40)


def test_equilibrium_carries_the_force_of_the_fiber(block):
    """Body and fiber act in parallel; the fiber adds its own force to that of the body."""
    material = neo_hookean(4.0, 40.0)
    x = block.nodes
    base, tip = (np.flatnonzero(np.abs(x[:, 0] - end) < 1e-9) for end in (0, 40))
    handle = RigidHandle(tip, np.array([40.0, 0, 0]), np.zeros(3), np.array([4.0, 0, 0]))
    plain = BoundaryConditions(base, (handle,))
    fibers = Fibers((np.array([[0.0, 0, 0], [40.0, 0, 0]]),), np.array([50.0]))
    results = [
        solve_ramp(block, material, conditions, [1.0])[0]
        for conditions in (plain, replace(plain, fibers=fibers))
    ]
    assert [r.status for r in results] == [Status.OK, Status.OK]
    energy = [r.statistics.energy for r in results]
    stored = 50.0 * 40 * (1.1**2 + 2 / 1.1 - 3) / 6
    # Both ends are held, so the stretch of the block is not uniform.
    assert energy[1] - energy[0] == pytest.approx(stored, rel=0.04)
    assert energy[1] - energy[0] >= stored  # the least energy at this mean stretch


def test_more_points_converge(block, field):
    energies = []
    for points in (1, 2, 3, None, 12):
        embedded = EmbeddedFibers(block, Fibers((WAVE, STRAIGHT), np.ones(2), True), points)
        energies.append(embedded.energy(embedded.vectors(field)))
    one, two, three, default = np.abs(np.array(energies[:-1]) / energies[-1] - 1)
    assert two < 0.05 * one
    assert three < two < 1e-3
    assert default < 1e-3


def test_parts_cover_the_lines(block):
    """Points are found in the tets that contain them, and their weights add up to the length."""
    embedded = EmbeddedFibers(block, Fibers((WAVE, STRAIGHT), np.ones(2), True))
    assert embedded.bary.min() > -1e-9
    length = np.linalg.norm(np.diff(WAVE, axis=0), axis=1).sum() + 40
    assert embedded.energy(embedded.vectors(block.nodes)) == pytest.approx(length / 2, rel=1e-6)


def test_filaments_have_the_moments_of_the_cross_section():
    fibers = Fibers.of_trace(STRAIGHT, (1.2, 0.8), np.array([0, 0, 2.0]), (112.0, 12.0))
    offset = np.array([line[0] - STRAIGHT[0] for line in fibers.lines])
    assert fibers.stiffness.sum() == pytest.approx(100 * 0.96)
    assert fibers.stiffness @ offset == pytest.approx(np.zeros(3), abs=1e-12)
    assert fibers.stiffness @ offset**2 == pytest.approx(
        [0, 100 * 0.8 * 1.2**3 / 12, 100 * 1.2 * 0.8**3 / 12]
    )


def test_stiffness_scales_with_the_simulated_modulus():
    normal, moduli = np.array([0, 0, 1.0]), (112.0, 12.0)
    scaled = Fibers.of_trace(STRAIGHT, (1.2, 0.8), normal, moduli, 1.0, (1, 1))
    assert scaled.stiffness == pytest.approx([100 * 0.96 / 12])


def test_filaments_stay_parallel_at_corners():
    path = np.array([[0.0, 0, 0], [10, 0, 0], [10, 6, 0]])
    fibers = Fibers.of_trace(path, (1.2, 0.8), np.array([0, 0, 1.0]), (20.0, 12.0), None, (2, 1))
    left, right = sorted(fibers.lines, key=lambda line: line[1, 0])
    offset = 0.6 / np.sqrt(3)
    assert left[1] == pytest.approx([10 - offset, offset, 0])
    assert right[1] == pytest.approx([10 + offset, -offset, 0])


@pytest.mark.parametrize(
    ("line", "stiffness", "code"),
    [
        (STRAIGHT, -1.0, "fiber-stiffness-negative"),
        (STRAIGHT + np.array([0, 20, 0]), 1.0, "fiber-outside-body"),
    ],
    ids=["soft", "outside"],
)
def test_invalid_fibers_are_refused(block, line, stiffness, code):
    with pytest.raises(SolveError) as error:
        EmbeddedFibers(block, Fibers((line,), np.array([stiffness])))
    assert error.value.code == code


def test_fibers_are_part_of_the_structure(block):
    plain = BoundaryConditions(np.array([0]))
    one, two = (replace(plain, fibers=Fibers((STRAIGHT,), np.array([k]))) for k in (1.0, 2.0))
    assert len({plain.structure, one.structure, two.structure}) == 3
    assert one.at_rest().structure == one.structure
    assert Loads(block, plain).fibers is None


def test_a_trace_along_the_direction_of_printing(block):
    """A piece that is parallel to the normal has filaments on all sides, too."""
    path = np.array([[10.0, 0.5, -1.0], [10.0, 0.5, 1.2], [20.0, 0.5, 1.2]])
    fibers = Fibers.of_trace(path, (0.8, 0.6), np.array([0.0, 0.0, 1.0]), (80.0, 12.0))
    embedded = EmbeddedFibers(block, fibers)
    vectors = embedded.vectors(np.zeros((len(block.nodes), 3)))
    assert np.isfinite(vectors).all()
    assert embedded.energy(vectors) == pytest.approx(0.0, abs=1e-12)
