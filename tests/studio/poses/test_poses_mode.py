"""Regions are chosen and poses made, by the mode's own methods; browsers are not part of this."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.runtime.view.camera import View
from defsense_fab.studio.poses.pose_part import HELD, MOVED
from defsense_fab.studio.poses.poses_mode import POSES, REGIONS
from defsense_fab.studio.poses.region_part import REFIT

LONG = 120.0
#: From in front of the bar, far off: 200 mm are seen across a square picture.
FRONT = View(
    np.array([75.0, -1000.0, 0.0]),
    np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]),
    2 * float(np.arctan(100 / 1000)),
    1.0,
)


@pytest.fixture
def mode(studio_page):
    made = studio_page.modes["Poses"]
    studio_page.enter("Poses")
    assert made.work.wait(LONG)
    return made


@pytest.fixture
def regions(mode):
    mode.show(REGIONS)
    return mode.regions


def place(x):
    """Where a point of the bar's front appears, from the left."""
    return 0.5 + (x - 75.0) / (2 * 98.5)


def rectangle(first, last):
    return np.array([place(first), 0.0]), np.array([place(last), 1.0])


def device_of(mode):
    return load_device(mode.bench.project.folder)


def turn(degrees):
    return np.deg2rad(degrees) * np.array([0.0, 1.0, 0.0])


def shown(mode):
    assert mode.work.wait(LONG)
    return mode.scene.body.vertices


def test_a_pose_is_shown_in_place_of_the_body_while_the_mode_is_entered(mode, studio_page):
    assert not mode.bench.body.visible
    assert np.abs(shown(mode) - mode.scene.points).max() > 10
    assert "as a build has it" in mode.poses.words.content
    studio_page.enter("Cords")
    assert mode.bench.body.visible
    assert mode.scene.gizmos._made == {}


def test_a_region_is_made_by_a_rectangle_and_undone(regions, mode):
    text = mode.bench.project.text
    regions.select(FRONT, *rectangle(60, 92))
    box = device_of(mode).regions["region"]
    inside = box.contains(mode.scene.points)
    x = mode.scene.points[:, 0]
    assert 59.9 < x[inside].min() < x[inside].max() < 92.1
    both = mode.scene.points[inside, 1]
    assert (both.min(), both.max()) == (-15, 15)  # those behind, too
    assert f"`region` holds {inside.sum()} points" in mode.bench._message.content
    assert regions.chosen == "region"
    assert regions._low.value == tuple(box.low)
    assert mode.bench.project.undo_name == "set the region `region`"
    mode.bench.project.undo()
    assert mode.bench.project.text == text
    assert regions.chosen is None


def test_a_rectangle_beside_the_body_makes_none(regions, mode):
    text = mode.bench.project.text
    regions.select(FRONT, np.zeros(2), np.array([0.05, 0.05]))
    assert mode.bench.message_code == "rectangle-empty"
    assert mode.bench.project.text == text


def test_regions_that_overlap_or_are_empty_are_told_at_once(regions, mode):
    assert "share" not in regions.words.content
    regions._does.value = REFIT
    regions.choose("tip")
    regions.select(FRONT, *rectangle(-5, 155))
    assert "`base` and `tip` share" in regions.words.content
    regions.set_corners(np.array([200.0, 0, 0]), np.array([210.0, 5, 5]))
    assert "`tip` holds no surface point: move or enlarge it." in regions.words.content
    before = mode.bench.project.text
    regions.set_corners(np.array([5.0, 0, 0]), np.array([1.0, 5, 5]))
    assert "first corner must be lower" in mode.bench._message.content
    assert mode.bench.project.text == before
    assert regions._low.value == (200.0, 0.0, 0.0)


def test_a_region_follows_its_gizmo_and_is_written_when_it_is_let_go(regions, mode):
    regions.choose("tip")
    grip = regions._grip
    box = device_of(mode).regions["tip"]
    text = mode.bench.project.text
    regions.moved("region", grip - np.array([30.0, 0, 0]), np.zeros(3), False)
    assert mode.bench.project.text == text
    held = mode.scene.body._held["tip"]
    assert mode.scene.points[held, 0].max() < 125
    regions.moved("region", grip - np.array([30.0, 0, 0]), np.zeros(3), True)
    assert device_of(mode).regions["tip"].low == pytest.approx(box.low - [30, 0, 0])
    assert mode.bench.project.undo_name == "move the region `tip`"
    regions.moved("region", regions._grip, np.zeros(3), True)  # taken hold of, and not moved
    assert mode.bench.project.undo_name == "move the region `tip`"


def test_regions_are_renamed_and_deleted_where_no_pose_needs_them(regions, mode):
    regions.choose("tip")
    regions._name.value = "end"
    regions.rename()
    assert list(device_of(mode).regions) == ["base", "end"]
    assert regions.chosen == "end"
    regions.delete()
    assert mode.bench.message_code == "region-in-use"
    regions._name.value = "a b"
    regions.rename()
    assert "letters, digits" in mode.bench._message.content
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
    mode._selected(event)
    assert mode.part == REGIONS
    assert "region" in device_of(mode).regions


def test_the_body_follows_a_hand_and_the_pose_is_written_when_it_lets_go(mode):
    text, before = mode.bench.project.text, shown(mode)
    for degrees in (-31, -33, -35):
        mode.poses.moved("tip", np.zeros(3), turn(degrees), False)
    during = shown(mode)
    assert 1 < np.abs(during - before).max() < 20
    assert mode.bench.project.text == text
    mode.poses.moved("tip", np.zeros(3), turn(-35), True)
    after = shown(mode)
    assert np.abs(after - during).max() < 1e-3
    handle = device_of(mode).poses[0].handles[0]
    assert np.rad2deg(handle.rotation) == pytest.approx([0, -35, 0])
    assert np.isnan(handle.translation).all()
    assert mode.bench.project.undo_name == "turn `tip` in `bend_up`"
    mode.bench.project.undo()
    assert np.abs(shown(mode) - before).max() < 1e-3


def test_coarse_and_fine_answers_are_counted(mode):
    mode.work.times.clear()
    mode.poses.moved("tip", np.zeros(3), turn(-33), False)
    shown(mode)
    (times,) = mode.work.times
    assert times.fine is not None
    if times.coarse is not None:
        assert times.coarse < times.fine


def test_two_people_drag_one_gizmo_and_the_last_wins(mode):
    gizmo = next(iter(mode.scene.gizmos._made.values()))
    hands = [threading.Thread(target=drag, args=(mode, gizmo, sign)) for sign in (-1, 1)]
    for hand in hands:
        hand.start()
    for hand in hands:
        hand.join(LONG)
    drag(mode, gizmo, -1)
    shown(mode)
    handle = device_of(mode).poses[0].handles[0]
    assert np.rad2deg(handle.rotation) == pytest.approx([0, -40, 0], abs=0.1)
    assert "as a build has it" in mode.poses.words.content


def drag(mode, gizmo, sign):
    """As the messages of one browser come."""
    from defsense_fab.studio.poses.gizmos import quaternion

    for k, phase in enumerate(("start", "update", "update", "update", "end")):
        target = SimpleNamespace(
            wxyz=quaternion(sign * turn(10 * max(k, 1))), position=gizmo.position
        )
        event = SimpleNamespace(client=object(), client_id=1, target=target, phase=phase)
        mode.scene.gizmos._dragged(event, "tip")


def test_a_pose_that_cannot_be_solved_is_told_and_the_last_good_shape_stays(mode):
    before = shown(mode)
    mode.poses.set_role("tip", MOVED)
    shown(mode)
    center = np.array([145.0, 0, 0])
    rotation = device_of(mode).poses[0].handles[0].rotation
    mode.poses.moved("tip", center - np.array([400.0, 0, 0]), rotation, True)
    after = shown(mode)
    assert "`bend_up` cannot be solved beyond" in mode.poses.words.content
    assert np.abs(after - before).max() < 0.5  # none of a coarse mesh, which bears more
    mode.bench.project.undo()
    assert np.abs(shown(mode) - before).max() < 0.1
    assert "as a build has it" in mode.poses.words.content


def test_a_pose_that_does_not_hold_the_body_is_told(mode):
    mode.poses.add()
    assert mode.poses.chosen == "pose"
    shown(mode)
    assert device_of(mode).poses[-1].fixed == ("base",)
    mode.poses.set_role("base", "left alone")
    shown(mode)
    assert "the body can still" in mode.poses.words.content
    assert "The last shape stays" in mode.poses.words.content


def test_poses_are_added_copied_renamed_and_deleted(mode):
    poses = mode.poses
    poses.duplicate()
    assert poses.chosen == "bend_up_2"
    poses._name.value = "bow"
    poses.rename()
    assert [p.name for p in device_of(mode).poses] == ["bend_up", "twist", "bow"]
    poses._name.value = "a pose"
    poses.rename()
    assert "letters, digits, - and _ only" in mode.bench._message.content
    assert poses.chosen == "bow"
    poses.delete()
    assert [p.name for p in device_of(mode).poses] == ["bend_up", "twist"]
    assert poses.chosen == "bend_up"


def test_roles_change_by_their_drop_downs(mode):
    shown(mode)
    lists = mode.poses.roles._lists
    assert lists["base"].value == HELD
    away = mode.poses._centers["tip"]
    mode.poses.set_role("tip", MOVED)
    handle = device_of(mode).poses[0].handles[0]
    assert handle.translation == pytest.approx(away - [145, 0, 0], abs=0.6)  # nothing jumps
    assert lists["tip"].value == MOVED
    mode.poses.set_role("tip", HELD)
    assert mode.bench.message_code == "pose-without-motion"
    assert lists["tip"].value == MOVED


def test_a_point_is_pulled_where_the_body_is_clicked(mode):
    pulls = mode.poses.pulls
    pulls._clicks.value = True
    pulls.pull(np.array([75.0, 0, 500]), np.array([0, 0, -1.0]))
    (drag_,) = device_of(mode).poses[0].drags
    assert drag_.at[2] == pytest.approx(15.0)
    assert drag_.by[2] > 10
    assert not pulls._clicks.value
    shown(mode)
    assert pulls._list.value.startswith("at ")
    assert pulls._lines is not None
    pulls.stiffen(0.25)
    assert device_of(mode).poses[0].drags[0].stiffness == 0.25
    pulls.remove()
    assert device_of(mode).poses[0].drags == ()
    assert pulls._lines is None
    pulls.pull(np.array([75.0, 0, 500]), np.array([0, 0, 1.0]))
    assert mode.bench.message_code == "no-body-point"


def test_the_ramp_is_solved_and_played(mode):
    ramp, frames = mode.ramp, []
    mode.poses.choose("twist")
    full = shown(mode)
    assert ramp.ramp is None  # the fixture's fields are by formula: not of this pose
    body, move = mode.scene.body, mode.scene.body.move
    body.move = lambda vertices: (frames.append(vertices), move(vertices))
    ramp.play()
    assert ramp.playing
    assert ramp._over.wait(LONG)
    assert len(frames) > 40
    assert "from the solver" in ramp.words.content
    assert np.abs(shown(mode) - full).max() < 1e-3
    ramp.show(0.0)
    assert np.abs(body.vertices - mode.scene.points).max() < 1e-9
    ramp.show(0.5)
    assert np.abs(body.vertices - full).max() > 1
    mode.poses.moved("tip", np.zeros(3), np.deg2rad(50) * np.array([1.0, 0, 0]), False)
    assert ramp.ramp is None
    shown(mode)


def test_a_share_is_solved_while_no_ramp_is_known(mode):
    full = shown(mode)
    mode.ramp.show(0.5)
    half = shown(mode)
    assert 1 < np.abs(half - full).max() < np.abs(mode.scene.points - full).max()
    assert "at 50%" in mode.poses.words.content


def test_cancelling_leaves_the_last_shape(mode):
    before = shown(mode)
    with mode.bench.drawing_lock:  # nothing is shown meanwhile
        mode.poses.moved("tip", np.zeros(3), turn(-70), False)
        mode.work.cancel()
    mode.poses.redraw(True)
    assert np.abs(shown(mode) - before).max() < 1e-3


def test_without_a_mesh_the_button_is_what_to_do(mode, studio_page):
    import shutil

    shutil.rmtree(mode.bench.project.folder / "build")
    studio_page.bench.load()
    assert mode._first.visible
    assert "Mesh the body" in mode._first.content
    assert not mode._folders[POSES].visible
    mode.regions.select(FRONT, *rectangle(60, 92))
    assert mode.bench.message_code == "not-meshed"
    mode.ramp.play()
    mode.suggestions.search()
    assert not mode.ramp.playing
