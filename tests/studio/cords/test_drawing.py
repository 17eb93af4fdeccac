"""Strokes that become cords, and edits of the chosen cord."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.curve import Hermite, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.studio.cords.cord_scene import with_point, with_tangent
from defsense_fab.workflow.design.draw_cord import drawing_planes
from tests.conftest import box_surface

TIMEOUT_S = 600.0
BODY = box_surface((0, -15, -10), (150, 15, 10))


def cord(name, plane, points):
    points = np.array(points, float)
    return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset({"path"}))


def test_tangents_follow_points_until_one_is_changed():
    plane = drawing_planes(BODY, ())["middle, normal to z"]
    first = cord("a", plane, [[0.0, 0], [30, 0], [60, 0]])
    moved = with_point(first, 1, np.array([30.0, 9.0]))
    np.testing.assert_allclose(moved.curve.tangents, catmull_rom(moved.curve.points))
    bent = with_tangent(moved, 0, np.array([0.0, 30.0]))
    moved_again = with_point(bent, 1, np.array([30.0, 2.0]))
    np.testing.assert_array_equal(moved_again.curve.tangents, bent.curve.tangents)
    assert moved_again.free == first.free


@pytest.fixture
def cords(studio_page):
    mode = studio_page.modes["Cords"]
    studio_page.enter("Cords")
    return mode


def sensors(mode):
    return {s.name: s for s in mode.bench.project.device.sensors}


def test_a_stroke_becomes_a_cord_and_the_next_one_replaces_its_path(cords):
    before = set(sensors(cords))
    plane = drawing_planes(cords.bench.surface, ())["middle, normal to z"]
    size = np.ptp(cords.bench.surface.vertices, axis=0)
    x = np.linspace(-0.6, 0.6, 80) * size.max()
    stroke = np.stack([x, 0.1 * size[1] * np.sin(3 * x / size.max())], axis=1)
    cords.drawing.finish_stroke(plane, stroke)
    (new,) = set(sensors(cords)) - before
    assert cords.chosen.name == new
    drawn = sensors(cords)[new].curve
    cords.chosen.is_replaced_by_strokes = True
    cords.drawing.finish_stroke(plane, stroke * [1, -1])
    assert set(sensors(cords)) - before == {new}
    np.testing.assert_allclose(sensors(cords)[new].curve.points, drawn.points * [1, -1], atol=2e-3)
    cords.drawing.finish_stroke(plane, stroke + np.array([0, 500]))
    assert cords.bench.status.code == "stroke-outside-body"
    assert set(sensors(cords)) - before == {new}


def test_tangents_points_and_mirrored_copies_are_written(cords):
    name, cord_ = next(iter(sensors(cords).items()))
    cords.choose(name)
    cords.drag(with_tangent(cord_, 1, np.array([9.0, 5.0])), "tangents", 1, True)
    np.testing.assert_allclose(sensors(cords)[name].curve.tangents[1], [9, 5])
    cords.chosen.smooth()
    tangents = sensors(cords)[name].curve.tangents
    np.testing.assert_allclose(tangents, catmull_rom(cord_.curve.points), atol=1e-3)
    count = len(cord_.curve.points)
    cords.chosen.add_point()
    assert len(sensors(cords)[name].curve.points) == count + 1
    cords.chosen.delete_point()  # no point was dragged since
    assert len(sensors(cords)[name].curve.points) == count + 1
    assert cords.bench.status.code == "no-point-dragged"
    cords.chosen.last_point = 1
    cords.chosen.delete_point()
    assert len(sensors(cords)[name].curve.points) == count
    cords.chosen.add_mirrored()
    copy = sensors(cords)[f"{name}-mirrored"]
    middle = cords.bench.surface.vertices.mean(axis=0)
    mirrored = copy.plane.to_world(copy.curve.points)
    original = sensors(cords)[name].plane.to_world(sensors(cords)[name].curve.points)
    np.testing.assert_allclose(mirrored[:, 1], 2 * middle[1] - original[:, 1], atol=2e-3)
    np.testing.assert_allclose(mirrored[:, [0, 2]], original[:, [0, 2]], atol=2e-3)


@pytest.mark.slow
def test_a_proposed_cord_lowers_the_error(cords):
    assert cords.error_worker.wait(TIMEOUT_S)
    before, count = cords.prediction.error, len(sensors(cords))
    cords.propose()
    assert cords.proposal_worker.wait(4 * TIMEOUT_S)
    assert len(sensors(cords)) == count + 1, cords.bench.status.text
    assert cords.bench.status.code == "cord-proposed"
    assert cords.error_worker.wait(TIMEOUT_S)
    assert cords.prediction.error < before


def test_two_cords_are_compared(cords):
    first, second = list(sensors(cords))[:2]
    cords.choose(first)
    cords.compare_with(second)
    assert cords.comparison_worker.wait(TIMEOUT_S)
    comparison = cords.comparison
    assert comparison.names == (first, second)
    others = [s for s in cords.bench.project.device.sensors if s.name != second]
    expected = cords.bench.judge.judge(others, quick=True).error
    assert comparison.errors_without[1] == expected
    assert -1 <= comparison.correlation <= 1
