"""The Cords mode, used through its buttons and handles without a browser."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.studio.cords.cord_scene import with_point
from defsense_fab.studio.edits.body import set_value

TIMEOUT_S = 600.0


@pytest.fixture
def cords(studio_page):
    mode = studio_page.modes["Cords"]
    studio_page.enter("Cords")
    assert mode.error_worker.wait(TIMEOUT_S)
    return mode


def predicted_error(cords):
    assert cords.error_worker.wait(TIMEOUT_S)
    return cords.prediction.error


def violations(cords):
    """Codes of the broken limits by the names of the cords."""
    assert cords.limits_worker.wait(TIMEOUT_S)
    return {(v.code, v.cords) for v in cords.check.violations}


def test_error_follows_a_dragged_point_which_is_written_on_release(cords):
    before, sensor = predicted_error(cords), cords.bench.project.device.sensors[0]
    text = cords.bench.project.text
    cords.choose(sensor.name)
    point = sensor.curve.points[2] + [0.0, 2.5]
    for share in np.linspace(0.2, 1.0, 5):
        moved = with_point(sensor, 2, sensor.curve.points[2] + share * np.array([0.0, 2.5]))
        cords.drag(moved, "points", 2, False)
    assert predicted_error(cords) != before
    assert cords.bench.project.text == text
    cords.drag(moved, "points", 2, True)
    device = load_device(cords.bench.project.folder)
    np.testing.assert_allclose(device.sensors[0].curve.points[2], point, atol=1e-3)
    cords.bench.project.undo()
    assert cords.bench.project.text == text
    assert predicted_error(cords) == before
    assert cords.bench.project.redo_name is not None


def test_cords_are_added_and_deleted(cords):
    names = [s.name for s in cords.bench.project.device.sensors]
    cords.add_straight()
    (new,) = {s.name for s in cords.bench.project.device.sensors} - set(names)
    assert cords.chosen.name == new
    assert cords.limits_worker.wait(TIMEOUT_S)
    assert len(cords.check.cords) == len(names) + 1
    cords.chosen.delete()
    assert [s.name for s in cords.bench.project.device.sensors] == names
    cords.chosen.delete()
    assert cords.bench.status.code == "no-cord-chosen"


def test_broken_limits_are_listed(cords):
    sensor = cords.bench.project.device.sensors[0]
    cords.drag(with_point(sensor, 2, sensor.curve.points[2] + [0.0, 60.0]), "points", 2, True)
    assert ("path-leaves-body", (sensor.name,)) in violations(cords)


def test_cords_are_checked_against_the_current_wall(cords):
    before = cords.bench.judge
    cords.bench.apply(set_value("fabrication", "wall", 6.5))
    assert cords.bench.wait(TIMEOUT_S)
    assert cords.bench.judge is not before
    assert "wall-too-thin" in {code for code, _ in violations(cords)}
