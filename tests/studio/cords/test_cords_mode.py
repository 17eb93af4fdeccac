"""Cords are drawn, by the page's own buttons and handles; browsers are not part of this."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.studio.cords.cord_scene import with_point
from defsense_fab.studio.edits.body import set_value

LONG = 60.0


@pytest.fixture
def cords(studio_page):
    mode = studio_page.modes["Cords"]
    studio_page.enter("Cords")
    assert mode._quick.wait(LONG)
    return mode


def error_told(cords):
    assert cords._quick.wait(LONG)
    assert cords._error.content.startswith(f"### {cords._shown.error:.2f} mm")
    return cords._shown.error


def test_an_error_follows_a_point_that_is_dragged_and_is_written_when_it_is_let_go(cords):
    before, sensor = error_told(cords), cords.bench.project.device.sensors[0]
    text = cords.bench.project.text
    cords.choose(sensor.name)
    place = sensor.curve.points[2] + [0.0, 2.5]
    for share in np.linspace(0.2, 1.0, 5):
        moved = with_point(sensor, 2, sensor.curve.points[2] + share * np.array([0.0, 2.5]))
        cords.drawn(moved, "points", 2, False)
    during = error_told(cords)
    assert during != before
    assert cords.bench.project.text == text
    cords.drawn(moved, "points", 2, True)
    device = load_device(cords.bench.project.folder)
    np.testing.assert_allclose(device.sensors[0].curve.points[2], place, atol=1e-3)
    assert cords.bench.project.undo_name == f"move control point 3 of `{sensor.name}`"
    cords.bench.project.undo()
    assert cords.bench.project.text == text
    assert error_told(cords) == before
    assert cords.bench.project.redo_name is not None


def test_cords_are_added_and_deleted(cords):
    names = [s.name for s in cords.bench.project.device.sensors]
    cords.add_straight()
    (new,) = {s.name for s in cords.bench.project.device.sensors} - set(names)
    assert cords._cord.name == new
    cords._limits_work.wait(LONG)
    assert f"| {new} |" in cords._limits.content
    cords._cord._delete()
    assert [s.name for s in cords.bench.project.device.sensors] == names
    cords._cord._delete()
    assert cords.bench._message.content == "Choose a cord first."


def test_what_breaks_a_limit_is_told(cords):
    sensor = cords.bench.project.device.sensors[0]
    cords.drawn(with_point(sensor, 2, sensor.curve.points[2] + [0.0, 60.0]), "points", 2, True)
    assert cords._limits_work.wait(LONG)
    assert f"cord '{sensor.name}' leaves the body" in cords._limits.content


def test_cords_are_judged_by_the_printer_and_decoder_that_there_are_now(cords):
    before = cords.bench.judge
    cords.bench.apply(set_value("fabrication", "wall", 6.5))
    assert cords.bench.wait(LONG)
    assert cords.bench.judge is not before
    assert cords._limits_work.wait(LONG)
    assert "6.50 mm is needed" in cords._limits.content
