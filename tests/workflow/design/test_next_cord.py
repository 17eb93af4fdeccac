"""The map of the next cord, compared with the judge of layouts."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import Plane
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.filaments import TraceSpec
from defsense_fab.core.device.pads import PADS
from defsense_fab.store.build import Build
from defsense_fab.workflow.design.body_section import BodySection
from defsense_fab.workflow.design.layout_judge import LayoutJudge
from defsense_fab.workflow.design.next_cord import (
    AddedCord,
    best_sensor,
    map_next_cord,
    shortest_cord,
)
from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.twin.conftest import small_bar as small_bar_fixture

pytestmark = pytest.mark.slow

small_bar, live_bar = small_bar_fixture, live_bar_fixture
PLANE = Plane.from_normal(np.array([75.0, 0, -6]), np.array([0, 0.2, 1.0]), np.eye(3)[0])


@pytest.fixture(scope="module")
def device(live_bar):
    return load_device(live_bar.folder)


def section_of(judge):
    everything = judge.task.everything
    return BodySection(everything.locator, everything.fields, judge.task.names)


def final_map(judge, sensors, length):
    *_, cord_map = map_next_cord(judge, section_of(judge), PLANE, sensors, length)
    assert cord_map.is_fine
    assert cord_map.share == 1.0
    return cord_map


@pytest.mark.parametrize("assembly", ["held", "bonded", "free", "printed"])
@pytest.mark.parametrize("length", [36.0, None])
def test_drops_match_the_judge(device, live_bar, assembly, length):
    has_pockets = assembly in ("held", "bonded")
    fabrication = replace(
        device.fabrication,
        assembly=assembly if has_pockets else "bonded",
        pockets=has_pockets,
    )
    trace = TraceSpec("eel", 1.2, 0.8, 120.0, 2.0, 3.0, 80.0, 0.15)
    device = replace(device, fabrication=fabrication)
    if assembly == "printed":
        cord = replace(device.cord, trace=trace)
        device = replace(device, cord=cord, pad=PADS["spring-pin"])
    judge = LayoutJudge(device, Build(live_bar.folder / "build"))
    sensors = device.sensors
    cord_map = final_map(judge, sensors, length)
    assert cord_map.error == judge.judge(sensors, quick=True).error
    some = np.flatnonzero(np.isfinite(cord_map.drop))
    assert len(some) > 20
    for at in [cord_map.best, *some[:: len(some) // 4]]:
        cord = best_sensor(cord_map, at, "next", judge)
        judged = judge.judge((*sensors, cord), quick=True)
        assert cord_map.error - cord_map.drop[at] == pytest.approx(judged.error, rel=1e-6)
    assert cord_map.best_drop == np.nanmax(cord_map.drop) > 0.01


def test_a_single_decoder_and_no_cord(device, live_bar):
    judge = LayoutJudge(replace(device, decoder="affine"), Build(live_bar.folder / "build"))
    cord_map = final_map(judge, (), 36.0)
    cord = best_sensor(cord_map, cord_map.best, "next", judge)
    judged = judge.judge((cord,))
    assert judged.decoder == "affine"
    assert cord_map.error - cord_map.best_drop == pytest.approx(judged.error, rel=1e-6)


def test_a_quadratic_decoder_replaces_a_slow_one(device, live_bar):
    build, sensors = Build(live_bar.folder / "build"), device.sensors
    slow = AddedCord(LayoutJudge(replace(device, decoder="kernel"), build), sensors)
    quadratic = LayoutJudge(replace(device, decoder="quadratic"), build)
    assert slow.error == quadratic.judge(sensors).error
    signals, noise = np.linspace(0, 0.05, 5)[:, None], np.array([0.002])
    expected = AddedCord(quadratic, sensors).errors(signals, noise)
    np.testing.assert_array_equal(slow.errors(signals, noise), expected)


def test_a_proposed_cord_keeps_the_limits(device, live_bar):
    judge = LayoutJudge(device, Build(live_bar.folder / "build"))
    cord_map = final_map(judge, device.sensors, None)
    cord = best_sensor(cord_map, cord_map.best, "next", judge)
    assert judge.check((*device.sensors, cord)).violations == ()
    # There is no room for another cord at its place.
    again = final_map(judge, (*device.sensors, cord), None)
    at = cord_map.points[cord_map.best]
    near = np.linalg.norm(again.points - at, axis=1).argmin()
    assert np.isnan(again.drop[near])


def test_a_short_cord_is_deep_enough_and_passes_through_its_point(device, live_bar):
    judge = LayoutJudge(device, Build(live_bar.folder / "build"))
    cord_map = final_map(judge, device.sensors, 40.0)
    for at in np.flatnonzero(np.isfinite(cord_map.drop))[::40]:
        a, b = cord_map.ends[at]
        assert np.linalg.norm(b - a) == pytest.approx(40.0)
        to = cord_map.points[at] - a
        along = to @ (b - a) / 40.0
        assert np.linalg.norm(to - along * (b - a) / 40.0) < 1e-9
        assert -1e-9 <= along <= 40.0 + 1e-9
        depth = judge.task.everything.depth(np.linspace(a, b, 50))
        assert depth.min() > judge.task.design.limits.depth - 0.3


def test_the_coarse_map_comes_first(device, live_bar):
    judge = LayoutJudge(device, Build(live_bar.folder / "build"))
    shares = []
    for cord_map in map_next_cord(judge, section_of(judge), PLANE, device.sensors, 36.0):
        shares.append(cord_map.share)
        if cord_map.share == 1.0:
            break
    assert not cord_map.is_fine
    assert shares == sorted(shares)
    assert len(shares) > 1


def test_a_short_cord_keeps_the_limits(device, live_bar):
    judge = LayoutJudge(device, Build(live_bar.folder / "build"))
    assert shortest_cord(judge.task) == np.ceil(judge.task.design.limits.shortest) == 34.0
