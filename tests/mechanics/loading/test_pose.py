"""Check poses and mixtures as boundary conditions, and refused input."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device import (
    Handle,
    MaterialSpec,
    PointDrag,
    Pose,
    RegionPressure,
    SymmetryPlane,
)
from defsense_fab.core.device.regions import Box
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.mesh import TetMesh
from defsense_fab.core.rotations import rotation_matrices
from defsense_fab.mechanics.elements.material import Material
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.loading.boundary_conditions import (
    BoundaryConditions,
    RigidHandle,
    State,
    continue_handles,
)
from defsense_fab.mechanics.loading.constraint_check import check_constraints
from defsense_fab.mechanics.loading.pose import mix_poses
from defsense_fab.mechanics.solver.batch import Job, solve_all
from defsense_fab.mechanics.solver.load_stepping import solve_ramp
from tests.conftest import structured_bar
from tests.support.errors import raises

REGIONS = {
    "base": Box(np.array([-1, -16, -16]), np.array([10, 16, 16])),
    "tip": Box(np.array([140, -16, -16]), np.array([151, 16, 16])),
    "side": Box(np.array([-1, -15.1, -16]), np.array([151, -14.9, 16])),
    "half": Box(np.array([-1, -16, -16]), np.array([80, 16, 16])),
    "far": Box(np.array([500, 0, 0]), np.array([501, 1, 1])),
    "edge": Box(np.array([-1, -15.1, -15.1]), np.array([151, -14.9, -14.9])),
}
FREE = np.full(3, np.nan)
NONE = np.zeros(3)


@pytest.fixture(scope="module")
def bar():
    return QuadraticMesh.from_linear(structured_bar([0, -15, -15], [150, 15, 15], (15, 3, 3)))


def pose(rotation=NONE, translation=FREE, name="p", region="tip", fixed=("base",), **more):
    handle = Handle(region, np.array(rotation, float), np.array(translation, float))
    return Pose(name, fixed, (handle,), **more)


def test_a_mixture_adds_motions_and_loads(bar):
    bent = pose([0, -0.5, 0], name="a", gravity=np.array([0, 0, -1.0]))
    drag = PointDrag(np.array([75.0, 0, 0]), np.array([0, 0, 8.0]), 0.2)
    press = (RegionPressure("side", 0.01),)
    twisted = pose([0.8, 0, 0], name="b", drags=(drag,), pressures=press)
    conditions = mix_poses([bent, twisted], {"a": 0.5, "b": 0.25}, REGIONS, bar, density=1.2)
    (handle,) = conditions.handles
    assert handle.rotation == pytest.approx([0.2, -0.25, 0])
    assert np.isnan(handle.translation).all()
    assert conditions.drags[0].by == pytest.approx([0, 0, 2])
    assert conditions.drags[0].stiffness == 0.2
    assert conditions.pressures[0].value == pytest.approx(0.0025)
    assert conditions.gravity == pytest.approx([0, 0, -0.5 * 9806.65 * 1.2e-9])
    a, b, c = (bar.nodes[conditions.pressures[0].faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(150 * 30)


def test_partly_free_translations_are_kept(bar):
    conditions = mix_poses([pose(translation=[5, np.nan, 2])], {"p": 0.5}, REGIONS, bar)
    assert conditions.handles[0].translation == pytest.approx([2.5, np.nan, 1], nan_ok=True)


@pytest.mark.slow
def test_a_region_free_in_one_pose_and_moved_in_another_is_solved_twice(bar):
    """The result equals that of prescribing the free equilibrium plus the further translation."""
    material = Material.from_spec(MaterialSpec("soft", 0.6, 0.45))
    bend, pull = pose([0, -0.4, 0], name="bend"), pose(translation=[12, 0, 3], name="pull")
    conditions = mix_poses([bend, pull], {"bend": 1.0, "pull": 0.5}, REGIONS, bar)
    assert np.isnan(conditions.handles[0].translation).all()
    assert conditions.handles[0].further_translation == pytest.approx([6, 0, 1.5])
    along = pose(translation=[12, np.nan, np.nan], name="along")
    free = mix_poses([bend, along], {"bend": 1.0, "along": 0.5}, REGIONS, bar)
    assert free.handles[0].further_translation == pytest.approx([6, np.nan, np.nan], nan_ok=True)
    ((pulled,),) = solve_all(bar, material, [Job(free, (1.0,))])
    (handle,) = pulled.state.conditions.handles
    assert np.isnan(handle.translation).tolist() == [False, True, True]
    still = mix_poses(
        [bend, pose(translation=NONE, name="still")], {"bend": 1, "still": 1}, REGIONS, bar
    )
    assert continue_handles(State(np.zeros(0), np.zeros(0), np.zeros((1, 3)), still)) is None
    ((half, whole),) = solve_all(bar, material, [Job(conditions, (0.5, 1.0))])
    for state, share in ((half, 0.5), (whole, 1.0)):
        alone = mix_poses([bend], {"bend": share}, REGIONS, bar)
        (found,) = solve_ramp(bar, material, alone, [1.0])
        place = found.state.translations[0] + share * np.array([6, 0, 1.5])
        direct = mix_poses([pose([0, -0.4 * share, 0], place)], {"p": 1.0}, REGIONS, bar)
        (expected,) = solve_ramp(bar, material, direct, [1.0])
        assert state.state.translations[0] == pytest.approx(place, abs=1e-6)
        assert np.abs(state.u - expected.u).max() < 1e-5


def test_a_rotation_about_a_point(bar):
    """A rotation about another point equals one about the tip's middle plus a translation."""
    about, turn = np.array([75.0, 0, 0]), np.array([0, 0.5, 0])
    handle = Handle("tip", turn, NONE, about=about)
    conditions = mix_poses([Pose("p", ("base",), (handle,))], {"p": 1.0}, REGIONS, bar)
    assert conditions.handles[0].center == pytest.approx(about)
    middle = np.array([145.0, 0, 0])
    shift = (rotation_matrices(turn) - np.eye(3)) @ (middle - about)
    same = mix_poses([pose(turn, shift)], {"p": 1.0}, REGIONS, bar)
    material = Material.from_spec(MaterialSpec("soft", 0.6, 0.45))
    (one,), (two,) = (solve_ramp(bar, material, c, [1.0]) for c in (conditions, same))
    assert np.abs(one.u - two.u).max() < 1e-5


@pytest.mark.parametrize(
    ("tip", "base", "code", "data"),
    [
        ("half", "base", "regions-overlap", {"regions": ("base", "tip")}),
        ("far", "base", "too-few-region-nodes", {"region": "tip", "count": 0}),
        ("tip", "edge", "region-on-a-line", {"region": "base"}),
    ],
)
def test_invalid_regions_are_refused(bar, tip, base, code, data):
    regions = {"tip": REGIONS[tip], "base": REGIONS[base]}
    with raises(DeviceError, code, **data):
        mix_poses([pose([0, 0.1, 0])], {"p": 1.0}, regions, bar)


def test_contradictory_mixtures_are_refused(bar):
    free = pose([0.1, 0, 0], name="free")
    aside = replace(
        free, name="aside", handles=(replace(free.handles[0], about=np.array([75.0, 0, 0])),)
    )
    swap = pose([0.1, 0, 0], name="swap", region="base", fixed=("tip",))
    hinge = replace(
        free, name="hinge", handles=(Handle("tip", NONE, FREE, np.array([[0, 1.0, 0]])),)
    )
    with raises(DeviceError, "region-fixed-and-moved", region="base"):
        mix_poses([free, swap], {"free": 0.5, "swap": 0.5}, REGIONS, bar)
    with raises(DeviceError, "rotation-centers-differ", region="tip"):
        mix_poses([free, aside], {"free": 0.5, "aside": 0.5}, REGIONS, bar)
    with raises(DeviceError, "region-free-and-rotated", region="tip"):
        mix_poses([free, hinge], {"free": 0.5, "hinge": 0.5}, REGIONS, bar)


def test_handles_must_stay_in_a_plane_of_symmetry(bar):
    plane = (SymmetryPlane("side", np.array([0, 1.0, 0])),)
    good = pose([0, 0.3, 0], [np.nan, 0, np.nan], symmetry=plane)
    assert len(mix_poses([good], {"p": 1.0}, REGIONS, bar).slides) == 1
    for bad in (pose([0.3, 0, 0], [0, 0, 0], symmetry=plane), pose([0, 0.3, 0], symmetry=plane)):
        with raises(DeviceError, "region-leaves-symmetry", region="tip"):
            mix_poses([bad], {"p": 1.0}, REGIONS, bar)
    thick = (SymmetryPlane("half", np.array([0, 1.0, 0])),)
    with raises(DeviceError, "region-not-planar", region="half"):
        mix_poses([pose([0, 0.3, 0], symmetry=thick)], {"p": 1.0}, REGIONS, bar)


def test_a_pressure_needs_a_surface(bar):
    inside = {**REGIONS, "core": Box(np.array([40, -6, -6]), np.array([90, 6, 6]))}
    with raises(DeviceError, "region-without-faces", region="core"):
        mix_poses([pose(pressures=(RegionPressure("core", 0.1),))], {"p": 1.0}, inside, bar)


def handle_on(mesh, low, translation, free_axes=None):
    nodes = np.flatnonzero(mesh.nodes[:, 0] >= low)
    axes = np.zeros((0, 3)) if free_axes is None else np.array(free_axes, float)
    return RigidHandle(nodes, mesh.nodes[nodes].mean(0), NONE, np.array(translation), axes, "tip")


def test_free_rigid_motions_are_refused(bar):
    nothing = np.array([], int)
    moved = handle_on(bar, 139, [np.nan, 0, 0])
    with raises(DeviceError, "body-not-held", pose="p", motion="move") as caught:
        check_constraints(bar, BoundaryConditions(nothing, (moved,)), "p")
    assert np.abs(caught.value.data["axis"]).tolist() == [1, 0, 0]
    hinged = handle_on(bar, 139, [0.0, 0, 0], [[0, 0, 1]])
    with raises(DeviceError, "body-not-held", pose="p", motion="turn") as caught:
        check_constraints(bar, BoundaryConditions(nothing, (hinged,)), "p")
    assert np.abs(caught.value.data["axis"]).tolist() == [0, 0, 1]
    held = handle_on(bar, 139, [0.0, 0, 0])
    assert check_constraints(bar, BoundaryConditions(nothing, (held,)), "p") == []


def test_disconnected_bodies_are_refused():
    a, b = (structured_bar([x, 0, 0], [x + 10, 10, 10], (1, 1, 1)) for x in (0, 20))
    both = TetMesh(np.concatenate([a.nodes, b.nodes]), np.concatenate([a.tets, b.tets + 8]))
    mesh = QuadraticMesh.from_linear(both)
    with raises(DeviceError, "body-in-pieces", count=2):
        check_constraints(mesh, BoundaryConditions(np.arange(3)), "p")


def test_small_regions_give_warnings_and_drags_outside_are_refused(bar):
    tip = np.flatnonzero(np.linalg.norm(bar.nodes - [150, 0, 0], axis=1) < 9)
    small = RigidHandle(tip, np.array([150.0, 0, 0]), NONE, np.array([1.0, 0, 0]), name="dot")
    base = np.flatnonzero(bar.nodes[:, 0] < 1)
    (warning,) = check_constraints(bar, BoundaryConditions(base, (small,)), "p")
    assert "'dot'" in warning
    outside = PointDrag(np.array([75.0, 0, 30]), NONE, 1.0)
    with raises(DeviceError, "drag-outside-body", point=(75.0, 0.0, 30.0)):
        check_constraints(bar, BoundaryConditions(base, drags=(outside,)), "p")
