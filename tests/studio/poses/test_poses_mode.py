"""The Poses mode, used by its methods without a browser."""

from __future__ import annotations

import shutil
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.rotations import rotation_matrices
from defsense_fab.studio.poses.poses_mode import REGIONS
from defsense_fab.workflow.view import View, quaternion

pytestmark = pytest.mark.slow

TIMEOUT_S = 600.0
#: A camera far in front of the bar, whose square picture shows 200 mm.
FRONT = View(
    np.array([75.0, -1000.0, 0.0]),
    np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]),
    2 * float(np.arctan(100 / 1000)),
    1.0,
)


@pytest.fixture
def mode(studio_page):
    mode = studio_page.modes["Poses"]
    studio_page.enter("Poses")
    assert mode.work.wait(TIMEOUT_S)
    return mode


@pytest.fixture
def regions(mode):
    mode.show(REGIONS)
    return mode.regions


def picture_position(x):
    """Return the position of a point of the bar's front in the picture, from the left."""
    return 0.5 + (x - 75.0) / (2 * 98.5)


def rectangle(first, last):
    return np.array([picture_position(first), 0.0]), np.array([picture_position(last), 1.0])


def device_of(mode):
    return load_device(mode.bench.project.folder)


def turn(degrees):
    return np.deg2rad(degrees) * np.array([0.0, 1.0, 0.0])


def shape(mode):
    """Return the vertices of the body once all requests are answered."""
    assert mode.work.wait(TIMEOUT_S)
    return mode.scene.body.vertices


def test_the_posed_body_replaces_the_body_while_the_mode_is_active(mode, studio_page):
    assert not mode.bench.body.visible
    assert np.abs(shape(mode) - mode.scene.points).max() > 10
    assert mode.poses.status.code == "checked"
    studio_page.enter("Cords")
    assert mode.bench.body.visible
    assert mode.scene.gizmos.positions == {}


def test_a_region_is_made_by_a_rectangle_and_undone(regions, mode):
    text = mode.bench.project.text
    regions.select(FRONT, *rectangle(60, 92))
    box = device_of(mode).regions["region"]
    inside = box.contains(mode.scene.points)
    x = mode.scene.points[:, 0]
    assert 59.9 < x[inside].min() < x[inside].max() < 92.1
    y = mode.scene.points[inside, 1]
    assert (y.min(), y.max()) == (-15, 15)  # also on the far side
    assert mode.bench.status.code == "region-set"
    assert regions.chosen == "region"
    assert regions.corners[0].tolist() == box.low.tolist()
    assert mode.bench.project.undo_name == "set the region `region`"
    mode.bench.project.undo()
    assert mode.bench.project.text == text
    assert regions.chosen is None


def test_a_rectangle_next_to_the_body_adds_no_region(regions, mode):
    text = mode.bench.project.text
    regions.select(FRONT, np.zeros(2), np.array([0.05, 0.05]))
    assert mode.bench.status.code == "rectangle-empty"
    assert mode.bench.project.text == text


def test_problems_of_regions_are_shown_at_once(regions, mode):
    assert regions.problems == ()
    regions.replaces_chosen = True
    regions.choose("tip")
    regions.select(FRONT, *rectangle(-5, 155))
    (problem,) = regions.problems
    assert (problem.code, problem.regions) == ("regions-share-points", ("base", "tip"))
    regions.set_corners(np.array([200.0, 0, 0]), np.array([210.0, 5, 5]))
    (problem,) = regions.problems
    assert (problem.code, problem.regions) == ("region-without-points", ("tip",))
    before = mode.bench.project.text
    regions.set_corners(np.array([5.0, 0, 0]), np.array([1.0, 5, 5]))
    assert mode.bench.status.code == "region-empty"
    assert mode.bench.project.text == before
    assert regions.corners[0].tolist() == [200.0, 0.0, 0.0]


def test_a_region_follows_its_gizmo_and_is_written_on_release(regions, mode):
    regions.choose("tip")
    grip = regions.grip_position
    box = device_of(mode).regions["tip"]
    text = mode.bench.project.text
    regions.follow_grip("region", grip - np.array([30.0, 0, 0]), np.zeros(3), False)
    assert mode.bench.project.text == text
    held = mode.scene.body.region_points["tip"]
    assert mode.scene.points[held, 0].max() < 125
    regions.follow_grip("region", grip - np.array([30.0, 0, 0]), np.zeros(3), True)
    assert device_of(mode).regions["tip"].low == pytest.approx(box.low - [30, 0, 0])
    assert mode.bench.project.undo_name == "move the region `tip`"
    regions.follow_grip(
        "region", regions.grip_position, np.zeros(3), True
    )  # released without a move
    assert mode.bench.project.undo_name == "move the region `tip`"


def test_regions_are_renamed_and_deleted_unless_a_pose_uses_them(regions, mode):
    regions.choose("tip")
    regions.new_name = "end"
    regions.rename()
    assert list(device_of(mode).regions) == ["base", "end"]
    assert regions.chosen == "end"
    regions.delete()
    assert mode.bench.status.code == "region-in-use"
    regions.new_name = "a b"
    regions.rename()
    assert mode.bench.status.code == "name-invalid"
    regions.select(FRONT, *rectangle(60, 92))
    regions.delete()
    assert list(device_of(mode).regions) == ["base", "end"]


def test_a_rectangle_in_a_browser_shows_regions(mode):
    (x, y, z, w) = (-(0.5**0.5), 0.0, 0.0, 0.5**0.5)  # looks along y, z being up
    camera = SimpleNamespace(
        position=FRONT.position, wxyz=(w, x, y, z), fov=FRONT.angle, aspect=1.0
    )
    low, high = rectangle(60, 92)
    event = SimpleNamespace(
        client=SimpleNamespace(camera=camera), screen_min=tuple(low), screen_max=tuple(high)
    )
    mode.follow_rectangle(event)
    assert mode.part == REGIONS
    assert "region" in device_of(mode).regions


def test_the_body_follows_a_gizmo_and_the_pose_is_written_on_release(mode):
    text, before = mode.bench.project.text, shape(mode)
    for degrees in (-31, -33, -35):
        mode.poses.follow_grip("tip", np.zeros(3), turn(degrees), False)
    during = shape(mode)
    assert 1 < np.abs(during - before).max() < 20
    assert mode.bench.project.text == text
    mode.poses.follow_grip("tip", np.zeros(3), turn(-35), True)
    after = shape(mode)
    assert np.abs(after - during).max() < 1e-3
    handle = device_of(mode).poses[0].handles[0]
    assert np.rad2deg(handle.rotation) == pytest.approx([0, -35, 0])
    assert np.isnan(handle.translation).all()
    assert mode.bench.project.undo_name == "turn `tip` in `bend_up`"
    mode.bench.project.undo()
    assert np.abs(shape(mode) - before).max() < 1e-3


def test_response_times_of_coarse_and_fine_shapes_are_measured(mode):
    mode.work.response_times.clear()
    mode.poses.follow_grip("tip", np.zeros(3), turn(-33), False)
    shape(mode)
    (times,) = mode.work.response_times
    assert times.fine_s is not None
    if times.coarse_s is not None:
        assert times.coarse_s < times.fine_s


def test_two_users_drag_one_gizmo_and_the_last_one_counts(mode):
    users = [threading.Thread(target=drag, args=(mode, sign)) for sign in (-1, 1)]
    for user in users:
        user.start()
    for user in users:
        user.join(TIMEOUT_S)
    drag(mode, -1)
    shape(mode)
    handle = device_of(mode).poses[0].handles[0]
    assert np.rad2deg(handle.rotation) == pytest.approx([0, -40, 0], abs=0.1)
    assert mode.poses.status.code == "checked"


def drag(mode, sign):
    """Turn the gizmo of the tip with the messages of one browser."""
    position = tuple(mode.scene.gizmos.positions["tip"])
    for k, phase in enumerate(("start", "update", "update", "update", "end")):
        wxyz = quaternion(rotation_matrices(sign * turn(10 * max(k, 1))))
        target = SimpleNamespace(wxyz=wxyz, position=position)
        event = SimpleNamespace(client=object(), client_id=1, target=target, phase=phase)
        mode.scene.gizmos.follow(event, "tip")


def test_the_last_shape_stays_if_a_pose_cannot_be_solved(mode):
    before = shape(mode)
    mode.poses.set_role("tip", "moved")
    shape(mode)
    center = np.array([145.0, 0, 0])
    rotation = device_of(mode).poses[0].handles[0].rotation
    mode.poses.follow_grip("tip", center - np.array([400.0, 0, 0]), rotation, True)
    after = shape(mode)
    assert mode.poses.status.code == "not-reached"
    assert np.abs(after - before).max() < 0.5  # not the coarse shape, which can be solved
    mode.bench.project.undo()
    assert np.abs(shape(mode) - before).max() < 0.1
    assert mode.poses.status.code == "checked"


def test_a_pose_that_does_not_hold_the_body_fails(mode):
    mode.poses.add()
    assert mode.poses.chosen == "pose"
    shape(mode)
    assert device_of(mode).poses[-1].fixed == ("base",)
    mode.poses.set_role("base", "free")
    shape(mode)
    assert mode.poses.status.code == "body-not-held"


def test_poses_are_added_copied_renamed_and_deleted(mode):
    poses = mode.poses
    poses.duplicate()
    assert poses.chosen == "bend_up_2"
    poses.new_name = "bow"
    poses.rename()
    assert [p.name for p in device_of(mode).poses] == ["bend_up", "twist", "bow"]
    poses.new_name = "a pose"
    poses.rename()
    assert mode.bench.status.code == "name-invalid"
    assert poses.chosen == "bow"
    poses.delete()
    assert [p.name for p in device_of(mode).poses] == ["bend_up", "twist"]
    assert poses.chosen == "bend_up"


def test_a_region_that_is_moved_from_now_on_stays_where_it_is(mode):
    shape(mode)
    assert mode.poses.roles.roles["base"] == "held"
    center = mode.poses.centers["tip"]
    mode.poses.set_role("tip", "moved")
    handle = device_of(mode).poses[0].handles[0]
    assert handle.translation == pytest.approx(center - [145, 0, 0], abs=0.6)
    assert mode.poses.roles.roles["tip"] == "moved"
    mode.poses.set_role("tip", "held")
    assert mode.bench.status.code == "pose-without-motion"
    assert mode.poses.roles.roles["tip"] == "moved"


def test_a_click_on_the_body_pulls_at_the_point(mode):
    pulls = mode.poses.pulls
    pulls.takes_clicks = True
    pulls.pull(np.array([75.0, 0, 500]), np.array([0, 0, -1.0]))
    (pull,) = device_of(mode).poses[0].drags
    assert pull.at[2] == pytest.approx(15.0)
    assert pull.by[2] > 10
    assert not pulls.takes_clicks
    shape(mode)
    assert len(pulls.names) == 1
    assert pulls.has_lines
    pulls.stiffen(0.25)
    assert device_of(mode).poses[0].drags[0].stiffness == 0.25
    pulls.remove()
    assert device_of(mode).poses[0].drags == ()
    assert not pulls.has_lines
    pulls.pull(np.array([75.0, 0, 500]), np.array([0, 0, 1.0]))
    assert mode.bench.status.code == "no-body-point"


def test_the_ramp_is_solved_and_played(mode):
    ramp, frames = mode.ramp, []
    mode.poses.choose("twist")
    full = shape(mode)
    assert ramp.ramp is None  # the fields of the fixture are computed by a formula
    body, move = mode.scene.body, mode.scene.body.move
    body.move = lambda vertices: (frames.append(vertices), move(vertices))
    ramp.play()
    assert ramp.is_playing
    assert ramp.wait(TIMEOUT_S)
    assert len(frames) > 40
    assert not ramp.ramp.is_simulated
    assert np.abs(shape(mode) - full).max() < 1e-3
    ramp.show(0.0)
    assert np.abs(body.vertices - mode.scene.points).max() < 1e-9
    ramp.show(0.5)
    assert np.abs(body.vertices - full).max() > 1
    mode.poses.follow_grip("tip", np.zeros(3), np.deg2rad(50) * np.array([1.0, 0, 0]), False)
    assert ramp.ramp is None
    shape(mode)


def test_a_share_is_solved_while_the_ramp_is_not_known(mode):
    full = shape(mode)
    mode.ramp.show(0.5)
    half = shape(mode)
    assert 1 < np.abs(half - full).max() < np.abs(mode.scene.points - full).max()
    assert mode.poses.status.code == "solved"


def test_the_last_shape_stays_after_cancel(mode):
    before = shape(mode)
    with mode.bench.drawing_lock:  # which showing an answer needs
        mode.poses.follow_grip("tip", np.zeros(3), turn(-70), False)
        mode.work.cancel()
    mode.poses.redraw(True)
    assert np.abs(shape(mode) - before).max() < 1e-3


def test_nothing_is_solved_without_a_mesh(mode, studio_page):
    shutil.rmtree(mode.bench.project.folder / "build")
    studio_page.bench.load()
    assert not mode.is_meshed
    mode.regions.select(FRONT, *rectangle(60, 92))
    assert mode.bench.status.code == "not-meshed"
    mode.ramp.play()
    assert mode.bench.status.code == "no-pose-chosen"
    mode.suggestions.search()
    assert mode.bench.status.code == "not-meshed"
    assert not mode.ramp.is_playing
