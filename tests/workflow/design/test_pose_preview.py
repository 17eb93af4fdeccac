"""Compare previews of edited poses with the results of a build."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device import PointDrag
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.regions import Box
from defsense_fab.core.errors import CaptureError, DeviceError, SolveError
from defsense_fab.mechanics.solver.load_stepping import Status
from defsense_fab.store.build import Build
from defsense_fab.store.fields import load_levels
from defsense_fab.store.mesh import load_mesh, load_mesh_record, load_region_nodes, save_mesh
from defsense_fab.workflow.build import stage_simulate
from defsense_fab.workflow.design import pose_preview, pose_ramp
from defsense_fab.workflow.design.pose_preview import (
    PosePreview,
    load_coarse_mesh,
    load_preview,
)
from defsense_fab.workflow.design.pose_ramp import follow_ramp, load_ramp, unreached_message
from tests.conftest import structured_bar
from tests.support.errors import raises
from tests.twin.conftest import small_bar as small_bar_fixture

pytestmark = pytest.mark.slow

small_bar = small_bar_fixture
COARSE = structured_bar([0, -15, -15], [150, 15, 15], (15, 2, 2))
CLOSE = 2e-5  # mm; fields are rounded to half of that


@pytest.fixture(scope="module")
def simulated(small_bar, tmp_path_factory):
    """The device in the folder of a bar that was meshed and simulated as builds do it."""
    folder = tmp_path_factory.mktemp("previewed") / "bar"
    shutil.copytree(small_bar, folder)
    device = load_device(folder)
    build = folder / "build"
    mesh = load_mesh(build)
    tags = {name: shape.contains(mesh.nodes) for name, shape in device.regions.items()}
    save_mesh(build, mesh, tags, load_mesh_record(build))
    stage_simulate.run(device, Build(build), lambda *_: None)
    return device


@pytest.fixture
def preview(simulated):
    made = load_preview(simulated)
    made.take_coarse(COARSE)
    yield made
    made.close()


def turned(pose, degrees, axis=(0.0, -1.0, 0.0)):
    handle = replace(pose.handles[0], rotation=np.deg2rad(degrees) * np.array(axis))
    return replace(pose, handles=(handle,))


def test_an_edited_pose_matches_the_build(simulated, preview):
    bend = simulated.poses[0]
    fields = load_levels(simulated.source / "build", bend.name)
    assert sorted(fields) == [0.25, 0.5, 0.75, 1.0]
    seen = []
    for degrees in (8, 19, 26):
        found = preview.edit(turned(bend, degrees), 1.0, seen.append, check=False)
        assert found.status is Status.OK
    found = preview.edit(bend)
    truth = preview.on_surface(fields[1.0])
    assert np.abs(found.moved - truth).max() < CLOSE
    assert len(seen) == 3
    assert all(len(u) == len(preview.surface.vertices) for u in seen)
    # The coarse answer to a small change is near the fine one.
    near = []
    last = preview.edit(turned(bend, 27), 1.0, near.append, check=False)
    assert np.abs(near[0] - last.moved).max() < 0.1 * np.abs(last.moved - found.moved).max()
    half = preview.edit(bend, 0.5)
    assert np.abs(half.moved - preview.on_surface(fields[0.5])).max() < CLOSE


def test_without_a_coarse_mesh_there_is_the_fine_answer(simulated):
    alone = load_preview(simulated)
    seen = []
    found = alone.edit(simulated.poses[1], 1.0, seen.append)
    truth = load_levels(simulated.source / "build", simulated.poses[1].name)[1.0]
    assert not seen
    assert not alone.has_coarse
    assert np.abs(found.moved - alone.on_surface(truth)).max() < CLOSE
    alone.close()


def test_positions_of_handles_are_returned(simulated, preview):
    found = preview.edit(simulated.poses[0])
    center = found.centers["tip"]
    assert center[0] < 145.0  # bent away from where it was
    assert abs(center[1]) < 0.5
    assert center[2] > 15.0
    pulled = replace(
        simulated.poses[0],
        handles=(),
        drags=(PointDrag(np.array([149.0, 0, 0]), np.array([0, 0, 20.0]), 0.5),),
    )
    assert preview.edit(pulled).moved[:, 2].max() > 2.0


def test_an_unsolved_pose_reports_its_share_and_keeps_the_last(simulated, preview):
    bend = simulated.poses[0]
    before = preview.edit(bend)
    crushed = replace(bend.handles[0], rotation=np.zeros(3), translation=np.array([-400.0, 0, 0]))
    failed = preview.edit(replace(bend, handles=(crushed,)))
    assert failed.moved is None
    assert failed.status is Status.NOT_REACHED
    assert 0 < failed.share < 0.5
    message = unreached_message("bend", 0.12)
    assert "`bend`" in message
    assert "12%" in message
    again = preview.edit(bend)
    assert np.abs(again.moved - before.moved).max() < CLOSE


def test_stopping_keeps_the_last_pose_and_a_newer_pose_skips_the_fine_answer(simulated, preview):
    bend = simulated.poses[0]
    before = preview.edit(bend)
    seen = []
    stopped = preview.edit(turned(bend, 40), 1.0, seen.append, stop=lambda: True)
    assert stopped.status is Status.CANCELLED
    assert not seen
    superseded = preview.edit(turned(bend, 35), 1.0, seen.append, newer=lambda: True)
    assert superseded.status is Status.CANCELLED
    assert len(seen) == 1
    assert np.abs(preview.edit(bend).moved - before.moved).max() < CLOSE


def test_an_invalid_pose_is_refused(simulated, preview):
    bend = simulated.poses[0]
    with raises(DeviceError, "body-not-held", pose=bend.name):
        preview.edit(replace(bend, fixed=()))
    wide = Box(np.array([-1.0, -16, -16]), np.array([142.0, 16, 16]))
    preview.take(replace(simulated, regions={**simulated.regions, "base": wide}))
    with raises(DeviceError, "regions-overlap"):
        preview.edit(bend)


def test_the_mesh_follows_regions_as_a_build_would_mesh_them(simulated, preview):
    rest = preview.surface.vertices
    np.testing.assert_array_equal(
        rest, load_mesh(simulated.source / "build").boundary().compact()[0].vertices
    )
    assert not preview.take(simulated)
    longer = Box(np.array([-1.0, -16, -16]), np.array([33.0, 16, 16]))
    assert preview.take(replace(simulated, regions={**simulated.regions, "base": longer}))
    moved = preview.surface.vertices
    assert (np.abs(moved[:, 0] - 33.0) < 1e-6).sum() > (np.abs(rest[:, 0] - 33.0) < 1e-6).sum()
    shorter = preview.edit(simulated.poses[0])
    assert shorter.status is Status.OK
    assert preview.take(simulated)
    np.testing.assert_array_equal(preview.surface.vertices, rest)


def test_a_ramp_is_loaded_from_a_build_of_the_same_pose(simulated, preview):
    folder, bend = simulated.source / "build", simulated.poses[0]
    full = preview.edit(bend).moved
    ramp = load_ramp(folder, preview, bend, full)
    assert ramp.is_simulated
    assert ramp.shares.tolist() == [0.25, 0.5, 0.75, 1.0]
    assert np.abs(ramp.at(1.0) - full).max() < CLOSE
    assert np.abs(ramp.at(0.0)).max() == 0
    solved = preview.edit(bend, 0.6).moved
    assert np.abs(ramp.at(0.6) - solved).max() < 0.002 * np.abs(solved).max()
    other = turned(bend, 31)
    assert load_ramp(folder, preview, other, preview.edit(other).moved) is None
    new = replace(bend, name="new")
    assert load_ramp(folder, preview, new, full) is None


def test_a_ramp_ignores_amplitudes_outside_0_to_1(simulated, preview, monkeypatch):
    """Mixtures of one pose with a weight below 0 or above 1."""
    folder, bend = simulated.source / "build", simulated.poses[0]
    levels = load_levels(folder, bend.name)
    more = {-0.5: -levels[0.5], **levels, 1.2: 1.2 * levels[1.0]}
    monkeypatch.setattr(pose_ramp, "load_levels", lambda *_: more)
    ramp = load_ramp(folder, preview, bend, preview.edit(bend).moved)
    assert ramp.shares.tolist() == [0.25, 0.5, 0.75, 1.0]
    assert np.abs(ramp.at(0.0)).max() == 0


def test_other_ramps_are_solved_from_rest(simulated, preview):
    bend = turned(simulated.poses[0], 40)
    full = preview.edit(bend).moved
    seen = []
    ramp = follow_ramp(preview, bend, full, None, lambda share, _: seen.append(share))
    assert seen == [0.2, 0.4, 0.6, 0.8, 1.0]
    assert not ramp.is_simulated
    assert ramp.remark == ""
    assert np.abs(ramp.at(1.0) - full).max() < 1e-3
    elsewhere = follow_ramp(preview, bend, full + 5.0)
    assert elsewhere.code == "other-equilibrium"
    assert follow_ramp(preview, bend, stop=lambda: True) is None
    crushed = replace(bend.handles[0], rotation=np.zeros(3), translation=np.array([-400.0, 0, 0]))
    with raises(SolveError, "pose-not-reached", pose="bend_up") as caught:
        follow_ramp(preview, replace(bend, handles=(crushed,)))
    assert 0.1 <= caught.value.data["share"] < 0.2
    less = replace(crushed, translation=np.array([-100.0, 0, 0]))
    short = follow_ramp(preview, replace(bend, handles=(less,)))
    assert short.code == "ramp-incomplete"
    assert short.shares[-1] == pytest.approx(0.6)


def test_without_a_mesh_there_is_no_preview(simulated, tmp_path):
    with raises(CaptureError, "not-built"):
        load_preview(replace(simulated, source=tmp_path))


def test_the_coarse_mesh_has_fewer_tets_and_is_kept(simulated, monkeypatch):
    made = load_coarse_mesh(simulated)
    assert len(made.tets) < len(load_mesh(simulated.source / "build").tets)
    monkeypatch.setattr(pose_preview, "tetrahedralize", None)
    assert load_coarse_mesh(simulated).digest == made.digest


def test_nodes_of_regions_are_read_back(simulated):
    read = load_region_nodes(simulated.source / "build")
    nodes = load_mesh(simulated.source / "build").nodes
    for name, shape in simulated.regions.items():
        np.testing.assert_array_equal(read[name], shape.contains(nodes))


def test_a_mesh_that_was_not_made_for_a_region_is_conformed_to_it(simulated):
    mesh = load_mesh(simulated.source / "build")
    longer = Box(np.array([-1.0, -16, -16]), np.array([33.0, 16, 16]))
    device = replace(simulated, regions={**simulated.regions, "base": longer})
    made = PosePreview(device, mesh, None, frozenset({"tip"}))
    assert np.abs(made.surface.vertices - load_preview(simulated).surface.vertices).max() > 0.1
