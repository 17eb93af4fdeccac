"""What hands draw on planes: places, snapping, strokes that become cords."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.studio.cords.cord_scene import with_point, with_tangent
from defsense_fab.studio.cords.drawing import moved, planes
from defsense_fab.studio.cords.drawing import on_plane
from defsense_fab.studio.cords.snapping import MIDDLE, SKIN, Snapping
from defsense_fab.studio.edits.cords import smooth
from tests.conftest import box_surface

LONG = 60.0
BODY = box_surface((0, -15, -10), (150, 15, 10))


def cord(name, plane, points):
    points = np.array(points, float)
    return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset({"path"}))


def test_planes_across_the_thin_side_come_first_and_lie_along_the_body():
    plane = planes(BODY, ())["middle, square to z"]
    assert list(planes(BODY, ())) == [f"middle, square to {a}" for a in "zyx"]
    np.testing.assert_allclose(plane.origin, [75, 0, 0])
    np.testing.assert_allclose(plane.axes[:, 0], [1, 0, 0])
    np.testing.assert_allclose(moved(plane, 4.0).origin, [75, 0, 4])
    own = cord("top", moved(plane, 3.0), [[0, 0], [10, 0]])
    assert planes(BODY, (own,))["of top"] is own.plane


def test_a_place_is_where_the_ray_of_the_eye_meets_the_plane():
    plane = Plane.from_normal(np.array([10.0, 0, 5]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))
    eye = np.array([10.0, 0, 105])
    np.testing.assert_allclose(on_plane(plane, eye, np.array([12.0, 3, 55])), [4, 6])
    assert on_plane(plane, eye, np.array([11.0, 0, 105])) is None  # along it
    assert on_plane(plane, eye, np.array([10.0, 0, 106])) is None  # away from it


def test_a_point_snaps_to_other_cords_to_the_skin_and_to_the_middle():
    plane = planes(BODY, ())["middle, square to z"]
    other = cord("side", plane, [[20.0, 8.0], [40, 8]])
    above = cord("above", moved(plane, 5.0), [[0.0, 3.0], [40, 3]])
    snap = Snapping(BODY, plane, (other, above), 1.0)
    assert snap(np.array([20.4, 8.3])).to == "`side`"
    np.testing.assert_allclose(snap(np.array([20.4, 8.3])).place, [20, 8])
    assert snap(np.array([0.2, 3.3])).to == MIDDLE  # the other cord lies above
    np.testing.assert_allclose(snap(np.array([0.2, 3.3])).place, [0, 3.3])
    np.testing.assert_allclose(snap(np.array([-0.6, 0.7])).place, [0, 0])
    assert snap(np.array([30.0, 14.6])).to == SKIN
    np.testing.assert_allclose(snap(np.array([30.0, 14.6])).place, [30, 15])
    free = snap(np.array([30.0, 5.0]))
    assert free.to == ""
    np.testing.assert_array_equal(free.place, [30, 5])


def test_tangents_follow_points_until_one_is_bent():
    plane = planes(BODY, ())["middle, square to z"]
    first = cord("a", plane, [[0.0, 0], [30, 0], [60, 0]])
    pulled = with_point(first, 1, np.array([30.0, 9.0]))
    np.testing.assert_allclose(pulled.curve.tangents, catmull_rom(pulled.curve.points))
    bent = with_tangent(pulled, 0, np.array([0.0, 30.0]))
    again = with_point(bent, 1, np.array([30.0, 2.0]))
    np.testing.assert_array_equal(again.curve.tangents, bent.curve.tangents)
    assert again.free == first.free


@pytest.fixture
def cords(studio_page):
    mode = studio_page.modes["Cords"]
    studio_page.enter("Cords")
    return mode


def sensors(mode):
    return {s.name: s for s in mode.bench.project.device.sensors}


def test_a_stroke_becomes_a_cord_and_another_takes_its_place(cords):
    before = set(sensors(cords))
    plane = planes(cords.bench.surface, ())["middle, square to z"]
    size = np.ptp(cords.bench.surface.vertices, axis=0)
    x = np.linspace(-0.6, 0.6, 80) * size.max()
    stroke = np.stack([x, 0.1 * size[1] * np.sin(3 * x / size.max())], axis=1)
    cords._drawing._done(plane, stroke)
    (new,) = set(sensors(cords)) - before
    assert cords._cord.name == new
    assert cords.bench.project.undo_name == f"draw `{new}`"
    drawn = sensors(cords)[new].curve
    cords._cord._again.value = True
    cords._drawing._done(plane, stroke * [1, -1])
    assert set(sensors(cords)) - before == {new}
    np.testing.assert_allclose(sensors(cords)[new].curve.points, drawn.points * [1, -1], atol=2e-3)
    assert cords.bench.project.undo_name == f"redraw `{new}`"
    cords._drawing._done(plane, stroke + np.array([0, 500]))
    assert "outside of the body's section" in cords.bench._message.content


def test_tangents_planes_and_copies_are_written(cords):
    name, cord_ = next(iter(sensors(cords).items()))
    cords.choose(name)
    cords.drawn(with_tangent(cord_, 1, np.array([9.0, 5.0])), "tangents", 1, True)
    assert cords.bench.project.undo_name == f"bend `{name}` at control point 2"
    np.testing.assert_allclose(sensors(cords)[name].curve.tangents[1], [9, 5])
    cords._cord._edit(lambda s: smooth(s.name))
    tangents = sensors(cords)[name].curve.tangents
    np.testing.assert_allclose(tangents, catmull_rom(cord_.curve.points), atol=1e-3)
    count = len(cord_.curve.points)
    cords._cord._edit(cords._cord._longer)
    assert len(sensors(cords)[name].curve.points) == count + 1
    cords._cord._delete_point()  # none was dragged since
    assert len(sensors(cords)[name].curve.points) == count + 1
    assert "Drag a point first" in cords.bench._message.content
    cords._cord.touched = 1
    cords._cord._delete_point()
    assert len(sensors(cords)[name].curve.points) == count
    cords._cord._edit(cords._cord._mirrored)
    copy = sensors(cords)[f"{name}-mirrored"]
    middle = cords.bench.surface.vertices.mean(axis=0)
    there = copy.plane.to_world(copy.curve.points)
    here = sensors(cords)[name].plane.to_world(sensors(cords)[name].curve.points)
    np.testing.assert_allclose(there[:, 1], 2 * middle[1] - here[:, 1], atol=2e-3)
    np.testing.assert_allclose(there[:, [0, 2]], here[:, [0, 2]], atol=2e-3)


def test_what_is_proposed_lowers_the_error(cords):
    assert cords._quick.wait(LONG)
    before, count = cords._shown.error, len(sensors(cords))
    cords.propose()
    assert cords._proposals.wait(4 * LONG)
    assert len(sensors(cords)) == count + 1, cords.bench._message.content
    assert "takes the expected error from" in cords.bench._message.content
    assert cords._quick.wait(LONG)
    assert cords._shown.error < before


def test_two_cords_are_compared(cords):
    one, two = list(sensors(cords))[:2]
    cords.choose(one)
    cords._other.value = two
    cords._give_slow()
    assert cords._slow.wait(LONG)
    told = cords._compared.content
    assert told.startswith(f"| | {one} | {two} |")
    assert "Their signals go together by" in told
    assert "error without it" in told.splitlines()[2]
