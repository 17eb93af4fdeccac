"""What the cords of a device must keep, and how they sense before they have ends."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.device.device import DECODERS
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.regions import Box, HalfSpace, Sphere
from defsense_fab.core.errors import DeviceError
from defsense_fab.decoding.expected_errors import LEFT_OUT, NONE
from defsense_fab.optimization.prediction.as_built import assumed_ends
from defsense_fab.optimization.prediction.design_task import (
    candidate_decoders,
    check_exits,
    layout_limits,
    signal_model,
)
from defsense_fab.sensing.built_cord import CordReading
from tests.conftest import box_surface
from tests.support.errors import raises
from tests.support.places import DEVICES


@pytest.fixture(scope="module")
def bar():
    return load_device(DEVICES / "bar")


def with_(device, **fabrication):
    return replace(device, fabrication=replace(device.fabrication, **fabrication))


def test_channels_are_long_enough_for_the_stretch_between_two_ends(bar):
    """20 mm, and two pockets of 7 mm; bends are left out where they leave too little."""
    assert layout_limits(bar).shortest == pytest.approx(20 + 2 * 7)
    assert layout_limits(with_(bar, strain_relief=True)).shortest > 40
    assert layout_limits(with_(bar, pockets=False)).shortest == 20
    assert np.isinf(layout_limits(bar).longest)


def test_without_unseen_states_only_the_affine_decoder_is_a_candidate(bar):
    left = SimpleNamespace(unseen=SimpleNamespace(how=LEFT_OUT))
    none = SimpleNamespace(unseen=SimpleNamespace(how=NONE))
    assert candidate_decoders(bar, left) == DECODERS
    assert candidate_decoders(bar, none) == ("affine",)
    assert candidate_decoders(replace(bar, decoder="kernel"), none) == ("kernel",)


def test_lengths_of_channels_follow_from_pieces(bar):
    """A piece of 100 mm: 5 mm of slack, half a ferrule in each of two pockets of 7 mm. It reaches
    further as it is stretched, where that is known; by 6 % about, where it is not."""
    short = replace(bar, cord=replace(bar.cord, lengths=(60.0, 100.0)))
    assert layout_limits(short).longest == pytest.approx(100 - 5 - 7 + 2 * 7)
    assert layout_limits(short).shortest == pytest.approx(1.06 * (60 - 5 - 7) + 2 * 7)
    given = layout_limits(with_(short, prestretch=0.1))
    assert given.longest == pytest.approx(1.1 * (100 - 5 - 7) + 2 * 7)
    assert given.shortest == pytest.approx(1.1 * (60 - 5 - 7) + 2 * 7)
    bonded = layout_limits(with_(short, assembly="bonded"))
    assert bonded.shortest == pytest.approx(60 - 5 - 7 + 2 * 7)
    assert layout_limits(with_(short, pockets=False)).longest == 100 - 5 - 7 - 2 * 20
    with raises(DeviceError, "cord-pieces-too-short", piece=30.0) as caught:
        layout_limits(replace(bar, cord=replace(bar.cord, lengths=(0.0, 30.0))))
    assert caught.value.data["needed"] == pytest.approx(34.0)


def test_the_signal_model_before_ends_are_known(bar):
    model, noise = signal_model(bar)
    assert not model.local
    assert (model.hidden, model.series) == (pytest.approx(11.45 - 2, abs=0.5), 0)
    assert noise == pytest.approx(0.002, rel=0.02)
    # 1 ohm at either joint is as much as 0.002 of some 49 mm of cord, less where it is stretched.
    assert model.contact == pytest.approx(np.sqrt(2) / 14.5 / noise / (1.12 / 1.06))
    e = np.array([-0.03, 0.05])
    assert model.response(e) == pytest.approx(2 * 1.06 / 1.12 * e)
    slack, _ = signal_model(with_(bar, prestretch=0.0))
    assert slack.response(e) == pytest.approx([0, 0.1])
    bonded, _ = signal_model(with_(bar, assembly="bonded"))
    assert bonded.local
    assert bonded.response(e) == pytest.approx(2 * e)
    free, _ = signal_model(with_(bar, pockets=False, assembly="bonded"))
    assert (free.hidden, free.series) == (0, 44)


@pytest.mark.parametrize(
    ("pockets", "hidden", "beyond"), [(True, 5.0, 0.0), (True, 0.0, 0.0), (False, 0.0, 44.0)]
)
def test_cords_extend_beyond_the_body_without_pockets(bar, pockets, hidden, beyond):
    """However shallow pockets are; 20 mm at either end, 2 mm from a path's end to the skin."""
    task = SimpleNamespace(
        fabrication=with_(bar, pockets=pockets).fabrication,
        reading=CordReading.from_device(bar),
        design=SimpleNamespace(sense=SimpleNamespace(hidden=hidden)),
    )
    assert assumed_ends(task, 100.0) == (hidden, beyond)


@pytest.mark.parametrize(
    ("region", "code"),
    [
        (Box(np.array([-1.0, -16, -16]), np.array([10.0, 16, 16])), None),
        (Box(np.array([-9.0, -16, -16]), np.array([0.0, 16, 16])), None),  # it ends at the skin
        (Box(np.array([20.0, -9, -9]), np.array([60.0, 9, 9])), "exit-off-skin"),
        (Box(np.array([-9.0, -16, -16]), np.array([-2.0, 16, 16])), "exit-off-skin"),
        (Sphere(np.array([75.0, 0, 15]), 1.0), "exit-too-small"),
        (HalfSpace(np.array([140.0, 0, 0]), np.array([1.0, 0, 0])), None),
    ],
)
def test_exits_need_room_on_the_skin(bar, region, code):
    """The bar extends from 0 to 150 mm and is 30 mm wide and high."""
    surface = box_surface((0, -15, -15), (150, 15, 15))
    device = replace(bar, regions={**bar.regions, "base": region}, exits=("base",))
    if code is None:
        check_exits(device, surface)
        return
    with raises(DeviceError, code):
        check_exits(device, surface)


def test_of_several_exits_one_needs_skin(bar):
    inner = Box(np.array([20.0, -9, -9]), np.array([60.0, 9, 9]))
    regions = {**bar.regions, "inner": inner}
    device = replace(bar, regions=regions, exits=("base", "inner"))
    check_exits(device, box_surface((0, -15, -15), (150, 15, 15)))
