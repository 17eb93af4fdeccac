"""Where the next cord would help, against the judge of layouts."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import Plane
from defsense_fab.core.device.device_file import load_device
from defsense_fab.optimize.prediction.body_section import BodySection
from defsense_fab.optimize.prediction.layout_judge import LayoutJudge
from defsense_fab.optimize.prediction.next_cord import (
    AddedCord,
    best_sensor,
    map_next_cord,
    shortest_cord,
)
from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.twin.conftest import small_bar as small_bar_fixture

small_bar, live_bar = small_bar_fixture, live_bar_fixture
PLANE = Plane.from_normal(np.array([75.0, 0, -6]), np.array([0, 0.2, 1.0]), np.eye(3)[0])


@pytest.fixture(scope="module")
def device(live_bar):
    return load_device(live_bar.folder)


def section_of(judge):
    everything = judge.task.everything
    return BodySection(everything.locator, everything.fields, judge.task.names)


def found_on(judge, sensors, length):
    *_, found = map_next_cord(judge, section_of(judge), PLANE, sensors, length)
    assert found.fine
    assert found.share == 1.0
    return found


@pytest.mark.parametrize("assembly", ["held", "bonded", "free"])
@pytest.mark.parametrize("length", [36.0, None])
def test_drops_match_the_judge(device, live_bar, assembly, length):
    made = replace(device.fabrication, assembly="bonded" if assembly == "free" else assembly,
                   pockets=assembly != "free")  # fmt: skip
    device = replace(device, fabrication=made)
    judge = LayoutJudge(device, live_bar.folder / "build")
    sensors = device.sensors
    found = found_on(judge, sensors, length)
    assert found.error == judge.judge(sensors, quick=True).error
    some = np.flatnonzero(np.isfinite(found.drop))
    assert len(some) > 20
    for at in [found.best, *some[:: len(some) // 4]]:
        cord = best_sensor(found, at, "next", judge)
        judged = judge.judge((*sensors, cord), quick=True)
        assert found.error - found.drop[at] == pytest.approx(judged.error, rel=1e-6)
    assert found.best_drop == np.nanmax(found.drop) > 0.01


def test_a_single_decoder_and_no_cord(device, live_bar):
    judge = LayoutJudge(replace(device, decoder="affine"), live_bar.folder / "build")
    found = found_on(judge, (), 36.0)
    cord = best_sensor(found, found.best, "next", judge)
    judged = judge.judge((cord,))
    assert judged.decoder == "affine"
    assert found.error - found.best_drop == pytest.approx(judged.error, rel=1e-6)


def test_a_quadratic_decoder_replaces_a_slow_one(device, live_bar):
    build, sensors = live_bar.folder / "build", device.sensors
    slow = AddedCord(LayoutJudge(replace(device, decoder="kernel"), build), sensors)
    quadratic = LayoutJudge(replace(device, decoder="quadratic"), build)
    assert slow.error == quadratic.judge(sensors).error
    signals, noise = np.linspace(0, 0.05, 5)[:, None], np.array([0.002])
    expected = AddedCord(quadratic, sensors).errors(signals, noise)
    np.testing.assert_array_equal(slow.errors(signals, noise), expected)


def test_a_proposed_cord_keeps_the_limits(device, live_bar):
    judge = LayoutJudge(device, live_bar.folder / "build")
    found = found_on(judge, device.sensors, None)
    cord = best_sensor(found, found.best, "next", judge)
    assert judge.check((*device.sensors, cord)).violations == ()
    # Where it lies there is no room for another.
    again = found_on(judge, (*device.sensors, cord), None)
    at = found.points[found.best]
    near = np.linalg.norm(again.points - at, axis=1).argmin()
    assert np.isnan(again.drop[near])


def test_a_short_cord_is_deep_enough_and_passes_through_its_point(device, live_bar):
    judge = LayoutJudge(device, live_bar.folder / "build")
    found = found_on(judge, device.sensors, 40.0)
    for at in np.flatnonzero(np.isfinite(found.drop))[::40]:
        a, b = found.ends[at]
        assert np.linalg.norm(b - a) == pytest.approx(40.0)
        to = found.points[at] - a
        along = to @ (b - a) / 40.0
        assert np.linalg.norm(to - along * (b - a) / 40.0) < 1e-9
        assert -1e-9 <= along <= 40.0 + 1e-9
        depth = judge.task.everything.depth(np.linspace(a, b, 50))
        assert depth.min() > judge.task.design.limits.depth - 0.3


def test_the_coarse_map_comes_first(device, live_bar):
    judge = LayoutJudge(device, live_bar.folder / "build")
    shares = []
    for found in map_next_cord(judge, section_of(judge), PLANE, device.sensors, 36.0):
        shares.append(found.share)
        if found.share == 1.0:
            break
    assert not found.fine
    assert shares == sorted(shares)
    assert len(shares) > 1


def test_a_short_cord_keeps_the_limits(device, live_bar):
    judge = LayoutJudge(device, live_bar.folder / "build")
    assert shortest_cord(judge.task) == np.ceil(judge.task.design.limits.shortest) == 34.0
