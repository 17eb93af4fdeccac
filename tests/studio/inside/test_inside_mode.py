"""The Inside mode, used through its buttons and handles without a browser."""

import threading

import numpy as np
import pytest

from defsense_fab.core.curve import Plane
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import LayoutError
from defsense_fab.studio.edits.cords import remove_cord
from defsense_fab.studio.inside import next_cord_search
from defsense_fab.studio.inside.plane_gizmo import plane_at
from defsense_fab.studio.inside.section_planes import (
    axis_plane,
    first_state,
    plane_offsets,
)
from defsense_fab.studio.inside.section_quantities import (
    ALONG_DIRECTION,
    LARGEST_STRETCH,
    NEXT_CORD,
    VARIANCE_OF_LARGEST,
)
from defsense_fab.workflow.design.next_cord import map_next_cord
from tests.support.errors import raises

pytestmark = pytest.mark.slow

TIMEOUT_S = 600.0
PLANE_OUTSIDE = Plane.from_normal(np.array([0.0, 0, 40.0]), np.eye(3)[2], np.eye(3)[0])


@pytest.fixture
def inside(studio_page):
    studio_page.enter("Inside")
    mode = studio_page.modes["Inside"]
    wait(mode)
    return mode


def wait(mode):
    """Wait for the section, the search that it starts, and the section with the map."""
    for _ in range(3):
        assert mode.sections.wait(TIMEOUT_S)
        assert mode.search.wait(TIMEOUT_S)
    assert mode.sections.wait(TIMEOUT_S)


def search_cords(mode, length=36.0):
    mode.next_panel.choose(length)
    mode.panel.choose(NEXT_CORD)
    mode.panel.on_change()
    wait(mode)


def test_the_first_full_pose_is_shown(inside):
    picture = inside.sections.picture
    assert inside.panel.quantity is LARGEST_STRETCH
    assert picture.request.quantity is LARGEST_STRETCH
    assert inside.bench.judge.task.names[picture.request.state] == "bend_up@1"
    assert picture.section.area == pytest.approx(150 * 30, rel=1e-6)
    assert np.abs(picture.positions - picture.section.points).max() > 1.0
    assert LARGEST_STRETCH.unit in picture.bar
    assert not inside.bench.body.visible


def test_the_section_is_hidden_in_other_modes(studio_page, inside):
    studio_page.enter("Cords")
    assert inside.sections.picture is None
    assert inside.bench.body.visible
    inside.panel.on_change()
    wait(inside)
    assert inside.sections.picture is None
    studio_page.enter("Inside")
    wait(inside)
    assert inside.sections.picture is not None


def test_planes_are_set_by_buttons_cords_and_the_offset(inside):
    inside.panel.on_axis(0)
    wait(inside)
    assert inside.sections.picture.section.area == pytest.approx(30 * 30, rel=1e-6)
    inside.panel.on_offset(20.0)
    wait(inside)
    np.testing.assert_allclose(inside.sections.picture.section.points[:, 0], 95.0)
    assert inside.panel.offset == pytest.approx(20.0)
    assert inside.panel.max_offset == pytest.approx(75.0)
    cord = inside.bench.project.device.sensors[0]
    inside.panel.on_plane(cord.plane)
    wait(inside)
    section = inside.sections.picture.section
    heights = (section.points - cord.plane.origin) @ cord.plane.normal
    np.testing.assert_allclose(heights, 0, atol=1e-9)


def test_rest_follows_the_last_state(inside):
    names = inside.bench.judge.task.names
    inside.panel.choose(VARIANCE_OF_LARGEST, names[-1])
    inside.next_state()
    wait(inside)
    picture = inside.sections.picture
    assert picture.request.state == 0
    assert VARIANCE_OF_LARGEST.unit in picture.bar


def test_the_error_of_a_search_is_shown_next_to_it(inside, monkeypatch):
    def fail(*args):
        raise LayoutError("the cords cannot be judged", code="not-finite")

    monkeypatch.setattr(next_cord_search, "map_next_cord", fail)
    search_cords(inside)
    assert inside.next_panel.status.code == "not-finite"


def test_dots_follow_a_drag_and_the_fine_section_comes_after(inside):
    before, fine = inside.sections.coarse_count, inside.sections.picture
    plane = axis_plane(inside.vertices, 1)
    inside.move_plane(Plane(np.array([75.0, 3, 0]), plane.axes), False)
    wait(inside)
    assert inside.sections.coarse_count == before + 1
    assert inside.sections.picture is not fine
    np.testing.assert_allclose(inside.sections.picture.section.points[:, 1], 3.0)
    inside.move_plane(Plane(np.array([75.0, 5, 0]), plane.axes), True)
    wait(inside)
    assert inside.sections.coarse_count == before + 1


def test_a_plane_that_misses_the_body_shows_an_error_and_the_whole_body(inside):
    inside.set_plane(PLANE_OUTSIDE)
    wait(inside)
    assert inside.panel.status.code == "plane-misses-body"
    assert inside.sections.picture is None
    assert np.ptp(inside.sections.shell[:, 0]) > 145
    inside.panel.on_axis(2)
    wait(inside)
    assert inside.sections.picture is not None
    assert inside.panel.status.error is None


def test_a_click_on_the_section_shows_the_numbers_of_the_point(inside):
    inside.panel.choose(ALONG_DIRECTION, "rest")
    inside.panel.on_axis(1)
    wait(inside)
    inside.click(np.array([75.0, -200.0, 2.0]), np.array([0.0, 1.0, 0.0]))
    point = inside.panel.point
    np.testing.assert_allclose(point.rest, [75.0, 0.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(point.position, point.rest)
    assert point.stretches["along the direction"] == pytest.approx(1.0)
    assert point.variance > 0
    inside.click(np.array([75.0, -200.0, 90.0]), np.array([0.0, 1.0, 0.0]))
    assert inside.panel.point is point


def test_the_best_cord_of_a_map_is_drawn_and_undone(inside):
    search_cords(inside, None)
    cord_map = inside.cord_map
    assert cord_map.is_fine
    assert inside.sections.picture.request.next_cord is cord_map
    assert inside.next_panel.status.code == "found"
    assert inside.next_panel.cord_map is cord_map
    text, before = inside.bench.project.text, len(inside.bench.project.device.sensors)
    inside.draw_best()
    sensors = load_device(inside.bench.project.folder).sensors
    assert len(sensors) == before + 1
    judged = inside.bench.judge.judge(sensors, quick=True)
    assert judged.error == pytest.approx(cord_map.error - cord_map.best_drop, abs=0.01)
    assert inside.bench.status.code == "cord-drawn"
    wait(inside)
    assert inside.cord_map.error == pytest.approx(judged.error)  # with the new cord
    inside.bench.project.undo()
    assert inside.bench.project.text == text


def test_no_cord_is_drawn_without_a_map(inside):
    with raises(LayoutError, "search-not-done"):
        inside.draw_best()


@pytest.fixture
def held_search(monkeypatch):
    """A search that sets `started` after its first map, and waits for `proceed`."""
    started, proceed, maps = threading.Event(), threading.Event(), []

    def search(*args):
        for cord_map in map_next_cord(*args):
            maps.append(cord_map)
            started.set()
            assert proceed.wait(TIMEOUT_S)
            yield cord_map

    monkeypatch.setattr(next_cord_search, "map_next_cord", search)
    return started, proceed, maps


def start_search(inside, started):
    inside.next_panel.choose(36.0)
    inside.panel.choose(NEXT_CORD)
    inside.panel.on_change()
    assert started.wait(TIMEOUT_S)


def test_a_canceled_search_ends_without_a_map(inside, held_search):
    started, proceed, maps = held_search
    start_search(inside, started)
    assert inside.next_panel.is_searching
    inside.cancel()
    proceed.set()
    wait(inside)
    assert inside.next_panel.status.code == "cancelled"
    assert len(maps) == 1
    assert inside.cord_map is None
    assert not inside.next_panel.is_searching


@pytest.mark.parametrize("change", ["plane", "cords", "mode"])
def test_a_search_ends_when_the_plane_or_the_cords_change(studio_page, inside, held_search, change):
    started, proceed, maps = held_search
    start_search(inside, started)
    request = inside.search_request
    if change == "plane":
        inside.move_plane(axis_plane(inside.vertices, 2), False)
    elif change == "cords":
        inside.bench.apply(remove_cord(inside.bench.project.device.sensors[0].name))
    else:
        studio_page.enter("Cords")
    assert inside.search_request is not request
    proceed.set()
    wait(inside)
    if change == "mode":
        assert inside.cord_map is None
        assert len(maps) == 1
    else:
        assert inside.cord_map.is_fine
        assert inside.search_request is not request
        np.testing.assert_array_equal(inside.cord_map.plane.axes, inside.plane.axes)


def test_planes_and_their_offsets():
    vertices = np.array([[0.0, -1, -2], [10, 1, 2]])
    plane = axis_plane(vertices, 0)
    assert plane_offsets(plane, vertices) == (0.0, -5.0, 5.0)
    turned = plane_at(np.array([1.0, 2, 3]), np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0]))
    np.testing.assert_allclose(turned.normal, [0, -1, 0], atol=1e-12)


def test_the_first_state_has_one_pose_at_its_largest():
    assert first_state(({}, {"a": 0.5}, {"a": 1.0}, {"a": 1.0, "b": 1.0})) == 2
    assert first_state(({},)) == 0
