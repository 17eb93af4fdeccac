"""Looking inside, by the page's own buttons and handles; browsers are not part of this."""

import threading

import numpy as np
import pytest

from defsense_fab.core.curve import Plane
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import LayoutError
from defsense_fab.optimize.prediction.next_cord import map_next_cord
from defsense_fab.studio.edits.cords import remove_cord
from defsense_fab.studio.inside import next_cord
from defsense_fab.studio.inside.section_quantities import LOOKS, NEXT_CORD
from defsense_fab.studio.inside.section_planes import plane_at
from defsense_fab.studio.inside.section_planes import axis_plane, first_state, offsets
from defsense_fab.studio.inside.section_view import hit_point

LONG = 60.0
FAR = Plane.from_normal(np.array([0.0, 0, 40.0]), np.eye(3)[2], np.eye(3)[0])


@pytest.fixture
def inside(studio_page):
    studio_page.enter("Inside")
    mode = studio_page.modes["Inside"]
    settled(mode)
    return mode


def settled(mode):
    """Until sections, searches and sections of what was found are done."""
    for _ in range(3):
        assert mode.work.wait(LONG)
        assert mode.search.wait(LONG)
    assert mode.work.wait(LONG)


def look_for_cords(mode, length=36.0):
    mode.next.choose(length)
    mode.panel.choose(NEXT_CORD)
    mode.panel.on_change()
    settled(mode)


def test_a_section_of_the_first_full_pose_is_shown(inside):
    picture = inside.work.picture
    assert inside.panel.look is LOOKS[1]
    assert inside.bench.judge.task.names[picture.wanted.state] == "bend_up@1"
    assert picture.section.area == pytest.approx(150 * 30, rel=1e-6)
    assert np.abs(picture.positions - picture.section.points).max() > 1.0
    assert "percent strain" in inside.panel._bar.content
    assert not inside.bench.body.visible


def test_it_goes_when_another_mode_is_entered_and_comes_back(studio_page, inside):
    studio_page.enter("Cords")
    assert inside.work.picture is None
    assert inside.bench.body.visible
    inside.panel.on_change()
    settled(inside)
    assert inside.work.picture is None
    studio_page.enter("Inside")
    settled(inside)
    assert inside.work.picture is not None


def test_planes_are_set_by_buttons_and_cords_and_the_offset(inside):
    inside.panel.on_axis(0)
    settled(inside)
    assert inside.work.picture.section.area == pytest.approx(30 * 30, rel=1e-6)
    inside.panel.on_offset(20.0)
    settled(inside)
    np.testing.assert_allclose(inside.work.picture.section.points[:, 0], 95.0)
    assert inside.panel._offset.value == pytest.approx(20.0)
    assert inside.panel._offset.max == pytest.approx(75.0)
    cord = inside.bench.project.device.sensors[0]
    inside.panel.on_plane(cord.plane)
    settled(inside)
    section = inside.work.picture.section
    np.testing.assert_allclose((section.points - cord.plane.origin) @ cord.plane.normal, 0,
                               atol=1e-9)  # fmt: skip


def test_states_follow_each_other(inside):
    names = inside.bench.judge.task.names
    inside.panel.choose(LOOKS[4], names[-1])
    inside.next_state()
    settled(inside)
    assert inside.work.picture.wanted.state == 0
    assert "square of stretch" in inside.panel._bar.content


def test_what_fails_in_a_search_is_told_beside_it(inside, monkeypatch):
    def broken(*args):
        raise LayoutError("nothing can be said of these cords")

    monkeypatch.setattr(next_cord, "map_next_cord", broken)
    look_for_cords(inside)
    assert inside.next._told.content == "**nothing can be said of these cords**"


def test_a_coarse_cut_follows_the_hand_and_the_fine_one_comes_after(inside):
    before, fine = inside.work.coarse, inside.work.picture
    plane = axis_plane(inside._vertices, 1)
    inside.moved(Plane(np.array([75.0, 3, 0]), plane.axes), False)
    settled(inside)
    assert inside.work.coarse == before + 1
    assert inside.work.picture is not fine
    np.testing.assert_allclose(inside.work.picture.section.points[:, 1], 3.0)
    inside.moved(Plane(np.array([75.0, 5, 0]), plane.axes), True)
    settled(inside)
    assert inside.work.coarse == before + 1


def test_a_plane_that_misses_the_body_is_told_and_the_next_one_is_drawn(inside):
    inside.set_plane(FAR)
    settled(inside)
    assert "25.0 mm" in inside.panel._said.content
    assert inside.work.picture is None
    vertices = inside.work._view._parts["shell"].vertices
    assert np.ptp(vertices[:, 0]) > 145  # the whole body is shown
    inside.panel.on_axis(2)
    settled(inside)
    assert inside.work.picture is not None
    assert "misses" not in inside.panel._said.content


def test_numbers_are_told_where_the_section_is_clicked(inside):
    inside.panel.choose(LOOKS[0], "rest")
    inside.panel.on_axis(1)
    settled(inside)
    inside.clicked(np.array([75.0, -200.0, 2.0]), np.array([0.0, 1.0, 0.0]))
    told = inside.panel._point.content
    assert "Point at rest (75.0, 0.0, 2.0) mm" in told
    assert "along the direction +0.0 %" in told
    assert "standard deviation" in told
    inside.clicked(np.array([75.0, -200.0, 90.0]), np.array([0.0, 1.0, 0.0]))
    assert inside.panel._point.content == told


def test_a_heat_map_becomes_a_cord_and_is_undone(inside):
    look_for_cords(inside, None)
    found = inside._found
    assert found.fine
    assert inside.work.picture.wanted.found is found
    assert f"→ {found.error - found.best_drop:.2f} mm" in inside.next._told.content
    text, before = inside.bench.project.text, len(inside.bench.project.device.sensors)
    inside.draw_best()
    sensors = load_device(inside.bench.project.folder).sensors
    assert len(sensors) == before + 1
    judged = inside.bench.judge.judge(sensors, quick=True)
    assert judged.error == pytest.approx(found.error - found.best_drop, abs=0.01)
    assert inside.bench.project.undo_name == "draw `cord`"
    assert "expected error" in inside.bench._message.content
    settled(inside)
    assert inside._found.error == pytest.approx(judged.error)  # beside the new cord
    inside.bench.project.undo()
    assert inside.bench.project.text == text


def test_without_a_map_nothing_is_drawn(inside):
    with pytest.raises(LayoutError, match="Wait until it is known"):
        inside.draw_best()


@pytest.fixture
def held_search(monkeypatch):
    """A search that waits after its first part: `begun`, and `go` to let it on."""
    begun, go, seen = threading.Event(), threading.Event(), []

    def slow(*args):
        for known in map_next_cord(*args):
            seen.append(known)
            begun.set()
            assert go.wait(LONG)
            yield known

    monkeypatch.setattr(next_cord, "map_next_cord", slow)
    return begun, go, seen


def begin_search(inside, begun):
    inside.next.choose(36.0)
    inside.panel.choose(NEXT_CORD)
    inside.panel.on_change()
    assert begun.wait(LONG)


def test_a_search_that_is_cancelled_ends_and_tells_no_map(inside, held_search):
    begun, go, seen = held_search
    begin_search(inside, begun)
    assert inside.next._bar.visible
    inside.cancel()
    go.set()
    settled(inside)
    assert inside.next._told.content.startswith("Cancelled.")
    assert len(seen) == 1
    assert inside._found is None
    assert not inside.next._bar.visible


@pytest.mark.parametrize("change", ["plane", "cords", "mode"])
def test_a_search_ends_when_plane_or_cords_change(studio_page, inside, held_search, change):
    begun, go, seen = held_search
    begin_search(inside, begun)
    old = inside._asked
    if change == "plane":
        inside.moved(axis_plane(inside._vertices, 2), False)
    elif change == "cords":
        inside.bench.apply(remove_cord(inside.bench.project.device.sensors[0].name))
    else:
        studio_page.enter("Cords")
    assert inside._asked is not old
    go.set()
    settled(inside)
    if change == "mode":
        assert inside._found is None
        assert len(seen) == 1
    else:
        assert inside._found.fine
        assert inside._asked is not old
        np.testing.assert_array_equal(inside._found.plane.axes, inside._plane.axes)


def test_small_things_about_planes():
    vertices = np.array([[0.0, -1, -2], [10, 1, 2]])
    plane = axis_plane(vertices, 0)
    assert offsets(plane, vertices) == (0.0, -5.0, 5.0)
    turned = plane_at(np.array([1.0, 2, 3]), np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0]))
    np.testing.assert_allclose(turned.normal, [0, -1, 0], atol=1e-12)
    assert first_state(({}, {"a": 0.5}, {"a": 1.0}, {"a": 1.0, "b": 1.0})) == 2
    assert first_state(({},)) == 0


def test_a_ray_meets_the_nearest_triangle():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]])
    triangles = np.array([[0, 1, 2], [3, 4, 5]])
    down = np.array([0.0, 0, -1])
    hit, weights = hit_point(np.array([0.2, 0.3, 5.0]), down, points, triangles)
    assert hit == 1
    np.testing.assert_allclose(weights, [0.5, 0.2, 0.3])
    assert hit_point(np.array([2.0, 0.3, 5.0]), down, points, triangles) is None
    assert hit_point(np.array([0.2, 0.3, -5.0]), down, points, triangles) is None
