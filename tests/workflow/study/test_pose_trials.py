"""Proposed poses are solved, and weakened or dropped where the body or the solver gives out."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.materials import elongation_at_break
from defsense_fab.core.device.regions import HalfSpace
from defsense_fab.core.storage.package_data import read_rows
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.solver.batch import solve_all
from defsense_fab.mechanics.solver.linear_response import Mode, ProposedPose
from defsense_fab.mechanics.solver.load_stepping import Status
from defsense_fab.workflow.study.pose_trials import try_poses
from tests.support.places import BAR

FREE, AXIS, ORIGIN = np.full(3, np.nan), np.array([1.0, 0, 0]), np.array([135.0, 0, 0])


def pose(name, rotation=(0, 0, 0), translation=FREE):
    mode = Mode(1.0, np.zeros((1, 3)), "bend", 1)
    return ProposedPose(name, mode, ORIGIN, AXIS, np.array(rotation, float), np.array(translation))


POSES = [
    pose("bend", (0, 0.5, 0)),
    pose("twist", (0.5, 0, 0)),
    pose("stretch", translation=(15.0, 0, 0)),
    pose("bend_2", (0, 0, 0.5)),
]


@pytest.fixture(scope="module")
def device():
    """A bar of a material that breaks at 90 %."""
    loaded = load_device(BAR)
    return replace(loaded, material=replace(loaded.material, name="eos-tpu-1301"))


@pytest.fixture(scope="module")
def mesh(bar_mesh):
    return QuadraticMesh.from_linear(bar_mesh)


def run(device, mesh, poses, solve=solve_all):
    return try_poses(device, mesh, "base", ("far_end", HalfSpace(ORIGIN, AXIS)), poses, solve)


def test_poses_within_the_material_stay_as_they_are(device, mesh):
    kept, notes = run(device, mesh, POSES)
    assert kept == POSES
    assert notes == []


def test_pose_beyond_the_material_is_weakened(device, mesh):
    long = pose("long", translation=(200.0, 0, 0))
    kept, (note,) = run(device, mesh, [*POSES, long])
    assert [p.name for p in kept] == [p.name for p in (*POSES, long)]
    assert 0 < kept[-1].translation[0] <= 0.5 * 200
    assert "90%" in note
    rubber = replace(device, material=replace(device.material, name="unknown"))
    assert run(rubber, mesh, [long]) == ([long], [])


def test_pose_that_is_not_reached_is_dropped(device, mesh):
    def solve(*arguments):
        results = solve_all(*arguments)
        for job, path in zip(arguments[2], results, strict=True):
            if job.name == "twist":
                path[:] = [replace(path[0], status=Status.OVER_BUDGET, state=None)]
        return results

    kept, (note,) = run(device, mesh, POSES, solve)
    assert [p.name for p in kept] == ["bend", "stretch", "bend_2"]
    assert note.startswith("twist")


def test_pose_that_takes_ten_times_the_median_is_weakened(device, mesh):
    def solve(*arguments):
        results = solve_all(*arguments)
        for job, path in zip(arguments[2], results, strict=True):
            if job.name == "bend" and job.fractions == (1.0,):
                path[0] = replace(path[0], statistics=replace(path[0].statistics, factors=200))
        return results

    kept, (note,) = run(device, mesh, POSES, solve)
    assert kept[0].rotation == pytest.approx(0.75 * POSES[0].rotation)
    assert kept[1:] == POSES[1:]
    assert note.startswith("bend ")


def test_every_material_has_an_elongation():
    for name in read_rows("materials.csv"):
        limit = elongation_at_break(name)
        assert limit is not None
        assert 0.5 < limit < 15
    assert elongation_at_break("custom") is None


@pytest.mark.slow
def test_pose_that_inverts_tets_is_weakened(device, mesh):
    crushed = pose("crush", translation=(-110.0, 0, 0))
    rubber = replace(device, material=replace(device.material, name="unknown"))
    kept, notes = run(rubber, mesh, [crushed])
    assert len(notes) == 1
    assert all(0 > p.translation[0] > -110 for p in kept)
