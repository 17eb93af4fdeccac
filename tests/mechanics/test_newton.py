"""Solved poses: patch test, equilibrium, failure as a status, and an independent solver."""

import shutil
import subprocess

import numpy as np
import pytest

from defsense_fab.core.device import Handle, Pose
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.regions import Box
from defsense_fab.mechanics import tet10
from defsense_fab.mechanics.linear_solver import NotPositiveDefinite, SymmetricSolver
from defsense_fab.mechanics.locate import PointLocator
from defsense_fab.mechanics.material import NeoHookean
from defsense_fab.mechanics.newton import solve_ramp
from defsense_fab.mechanics.pose import BoundaryConditions, RigidMotion, mix
from defsense_fab.mechanics.tet10 import QuadraticMesh
from defsense_fab.sensing.signal import signals

MATERIAL = NeoHookean(0.2, 5.0)
REGIONS = {
    "base": Box(np.array([-1, -16, -16]), np.array([10, 16, 16])),
    "tip": Box(np.array([140, -16, -16]), np.array([151, 16, 16])),
}


def pose(rotation, translation=None, name="p"):
    return Pose(name, ("base",), (Handle("tip", np.array(rotation), translation),))


@pytest.fixture(scope="module")
def mesh(bar_mesh):
    return QuadraticMesh.from_linear(bar_mesh)


def test_patch_test_uniform_stretch(mesh):
    """Boundary nodes moved by a homogeneous field: the inside must follow it."""
    G = np.array([[0.1, 0.02, 0], [0, -0.04, 0.01], [0.03, 0, -0.05]])
    target = mesh.nodes @ G.T
    faces = np.abs(mesh.nodes - [75, 0, 0]) > np.array([75, 15, 15]) - 0.3
    motions = tuple(
        RigidMotion(np.array([n]), mesh.nodes[n], np.zeros(3), target[n])
        for n in np.flatnonzero(faces.any(1))
    )
    result = solve_ramp(mesh, MATERIAL, BoundaryConditions(np.array([], int), motions), [1.0])[-1]
    assert np.abs(result.u - target).max() < 1e-5


def test_free_translation_leaves_no_force(mesh):
    conditions = mix([pose([0, -0.5, 0])], {"p": 1.0}, REGIONS, mesh.nodes)
    result = solve_ramp(mesh, MATERIAL, conditions, [0.5, 1.0])[-1]
    force = tet10.forces(mesh, MATERIAL, result.u)
    tip = conditions.motions[0].nodes
    held = np.concatenate([tip, conditions.fixed])
    inner = np.setdiff1d(np.arange(len(mesh.nodes)), held)
    assert np.abs(force[inner]).max() < 1e-5 * np.abs(force).max()
    assert np.abs(force[tip].sum(0)).max() < 1e-5 * np.abs(force).max()


def test_impossible_pose_is_a_status_without_a_field(mesh):
    """The regions leave no node free between them: elements there turn inside out for certain."""
    far = np.array([1e3, 1e3, 1e3])
    regions = {
        "base": Box(-far, np.array([70.0, 1e3, 1e3])),
        "tip": Box(np.array([70.0 + 1e-6, -1e3, -1e3]), far),
    }
    squeeze = pose([0, 0, 0], np.array([-60.0, 0, 0]))
    conditions = mix([squeeze], {"p": 1.0}, regions, mesh.nodes)
    result = solve_ramp(mesh, MATERIAL, conditions, [1.0])[-1]
    assert not result.converged
    assert result.u is None
    assert 0 <= result.amplitude < 1


def test_a_wholly_prescribed_body_needs_no_solver(mesh):
    every = np.arange(len(mesh.nodes))
    moved = RigidMotion(every, np.array([75.0, 0, 0]), np.array([0, 0, 0.4]), np.array([3.0, 0, 0]))
    conditions = BoundaryConditions(np.array([], int), (moved,))
    result = solve_ramp(mesh, MATERIAL, conditions, [1.0])[-1]
    assert result.energy == pytest.approx(0, abs=1e-6)
    assert result.u.mean(0)[0] != 0


def test_mixture_adds_rotation_vectors(mesh):
    poses = [pose([0, -0.5, 0], name="a"), pose([0.8, 0, 0], name="b")]
    conditions = mix(poses, {"a": 0.5, "b": 0.25}, REGIONS, mesh.nodes)
    assert conditions.motions[0].rotation == pytest.approx([0.2, -0.25, 0])
    assert conditions.motions[0].translation is None


def test_overlapping_regions_are_refused(mesh):
    regions = {**REGIONS, "tip": Box(np.array([5, -16, -16]), np.array([151, 16, 16]))}
    with pytest.raises(DeviceError, match="overlap"):
        mix([pose([0, 0.1, 0])], {"p": 1.0}, regions, mesh.nodes)


def test_empty_region_is_refused(mesh):
    regions = {**REGIONS, "tip": Box(np.array([500, 0, 0]), np.array([501, 1, 1]))}
    with pytest.raises(DeviceError, match=r"regions\.tip: holds 0 nodes"):
        mix([pose([0, 0.1, 0])], {"p": 1.0}, regions, mesh.nodes)


def test_solver_refuses_an_indefinite_matrix():
    import scipy.sparse as sp

    upper = sp.csr_matrix(np.array([[1.0, 2.0], [0.0, 1.0]]))
    solver = SymmetricSolver()
    with pytest.raises(NotPositiveDefinite):
        solver.solve(upper, np.ones(2))


def test_fallback_solver_gives_the_same(mesh):
    import scipy.sparse as sp

    rng = np.random.default_rng(0)
    a = rng.normal(size=(20, 20))
    upper = sp.csr_matrix(np.triu(a @ a.T + np.eye(20)))
    right = rng.normal(size=20)
    first, second = SymmetricSolver(), SymmetricSolver()
    second._pardiso = None
    assert first.solve(upper, right) == pytest.approx(second.solve(upper, right), rel=1e-8)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
@pytest.mark.parametrize("rotation", [[0, -0.5236, 0], [0.7854, 0, 0]], ids=["bend", "twist"])
def test_against_calculix(mesh, tmp_path, rotation):
    """The same quadratic tets, energy and end positions in CalculiX C3D10."""
    conditions = mix([pose(rotation)], {"p": 1.0}, REGIONS, mesh.nodes)
    ours = solve_ramp(mesh, MATERIAL, conditions, [0.5, 1.0])[-1].u
    theirs = calculix(mesh, conditions, ours, tmp_path)
    assert np.abs(ours - theirs).max() < 0.1
    locator = PointLocator(mesh)
    x = np.linspace(2, 148, 120)
    for y, z in ((0, 10), (8, -6)):
        path = np.stack([x, np.full_like(x, y), np.full_like(x, z)], axis=1)
        moved = path + locator.displacement(locator.find(path), np.stack([ours, theirs]))
        a, b = signals(path, moved, 1.0)
        assert a == pytest.approx(b, rel=0.01, abs=1e-4)


def calculix(mesh, conditions, ours, folder):
    """Displacements (n, 3) by CalculiX; all prescribed nodes get the positions of ours."""
    order = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]  # C3D10 numbers its edge nodes as VTK does
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i + 1}, {x:.12g}, {y:.12g}, {z:.12g}" for i, (x, y, z) in enumerate(mesh.nodes)]
    lines.append("*ELEMENT, TYPE=C3D10, ELSET=BODY")
    lines += [
        ", ".join(str(v) for v in [e + 1, *(cell[order] + 1)]) for e, cell in enumerate(mesh.cells)
    ]
    lines += [
        "*MATERIAL, NAME=SOFT",
        "*HYPERELASTIC, NEO HOOKE",
        f"{MATERIAL.mu / 2:.12g}, {2 / MATERIAL.kappa:.12g}",
        "*SOLID SECTION, ELSET=BODY, MATERIAL=SOFT",
        "*STEP, NLGEOM, INC=200",
        "*STATIC",
        "0.1, 1.",
        "*BOUNDARY",
    ]
    prescribed = [conditions.fixed, *(m.nodes for m in conditions.motions)]
    for n in np.concatenate(prescribed):
        lines += [f"{n + 1}, {d + 1}, {d + 1}, {ours[n, d]:.12g}" for d in range(3)]
    lines += ["*NODE PRINT, NSET=ALL, FREQUENCY=1000", "U", "*END STEP", ""]
    (folder / "job.inp").write_text("\n".join(lines))
    subprocess.run(["ccx", "job"], cwd=folder, check=True, capture_output=True, timeout=600)
    rows = [r.split() for r in (folder / "job.dat").read_text().splitlines()]
    table = np.array([[float(v) for v in r] for r in rows if len(r) == 4])
    u = np.zeros_like(mesh.nodes)
    last = table[-len(mesh.nodes) :]
    u[last[:, 0].astype(int) - 1] = last[:, 1:]
    return u


def test_mixtures_that_contradict_themselves_are_refused():

    x = np.random.default_rng(0).uniform(0, 10, (400, 3))
    regions = {
        "a": Box(np.array([-1, -1, -1.0]), np.array([3, 11, 11.0])),
        "b": Box(np.array([7, -1, -1.0]), np.array([11, 11, 11.0])),
    }
    turn = np.array([0.1, 0, 0])
    free = Pose("free", ("a",), (Handle("b", turn, None),))
    pull = Pose("pull", ("a",), (Handle("b", 0 * turn, np.array([1.0, 0, 0])),))
    swap = Pose("swap", ("b",), (Handle("a", turn, None),))
    with pytest.raises(DeviceError, match="both fixes and moves region 'a'"):
        mix([free, swap], {"free": 0.5, "swap": 0.5}, regions, x)
    with pytest.raises(DeviceError, match="both freely and by a translation"):
        mix([free, pull], {"free": 0.5, "pull": 0.5}, regions, x)
    motion = mix([pull], {"pull": 0.5}, regions, x).motions[0]
    assert motion.translation == pytest.approx([0.5, 0, 0])
