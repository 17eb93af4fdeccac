"""A session next to twins of the families of memories that its device can have."""

import json
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.filaments import TraceSpec
from defsense_fab.report.evaluation.data_files import _plain
from defsense_fab.training.data.dataset import Dataset, Recording
from defsense_fab.twin.electronics.rubber_cords import (
    CORD_FAMILIES,
    RubberPieces,
    RubberState,
    RubberTraits,
)
from defsense_fab.workflow.train.twin_likeness import compare_with_twins
from tests.support.places import BAR

#: Families of the memory of cords.
CORDS = ["viscoelastic", "hysteretic"]


def make_session(family, seconds=120.0, unit=True):
    """Return a session of a marker and two cords of a family of the twin's."""
    rng = np.random.default_rng(3)
    time = np.arange(0, seconds, 1 / 30)
    knots = np.arange(0, seconds + 1, 1.5)
    x = np.interp(time, knots, rng.uniform(0, 1, len(knots)) * (rng.random(len(knots)) > 0.3))
    points = np.zeros((len(time), 1, 3))
    points[:, 0, 0] = 30 * x
    traits = RubberTraits(CORD_FAMILIES[family]())
    pieces = RubberPieces.draw(traits, np.full(2, 2000.0), rng)
    signals = np.column_stack([0.3 * x, 0.2 * x - 0.1 * x**2])
    ohm, _ = pieces.simulate(time, signals, RubberState.new(traits, 2), rng)
    rest = pieces.ohm if unit else np.ones(2)
    ohm = ohm if unit else ohm / pieces.ohm
    run = Recording("r", "s", "u", time, ohm, rest, time, points, np.full_like(points, 0.1))
    return Dataset("d", "", ("a", "b"), np.arange(1), points[0], (run,))


@pytest.fixture(scope="module")
def device():
    return load_device(BAR)


@pytest.mark.parametrize("family", CORDS)
def test_session_of_a_family_is_like_its_own_twins(device, family):
    likeness = compare_with_twins(make_session(family), device)
    assert set(likeness.twins) == set(CORDS)

    def distance(name):
        low, high = (r.hysteresis for r in likeness.twins[name])
        middle = np.sqrt(low * high)
        return abs(np.log(likeness.session.hysteresis / middle))

    assert min(CORDS, key=distance) == family
    again = compare_with_twins(make_session(family), device)
    assert again == likeness
    json.dumps(_plain(likeness.to_json()), allow_nan=False)


def test_printed_traces_are_also_compared_with_their_network(device):
    trace = TraceSpec("eel", 1.2, 0.8, 120.0, 2.0, 3.0, 80.0, 0.15)
    printed = replace(device, cord=replace(device.cord, trace=trace))
    likeness = compare_with_twins(make_session("network"), printed)
    assert set(likeness.twins) == set(CORD_FAMILIES)
    low, high = (r.hysteresis for r in likeness.twins["network"])
    assert low < likeness.session.hysteresis < 1.5 * high


def test_session_without_a_device_has_its_own_numbers_only():
    likeness = compare_with_twins(make_session("hysteretic"))
    assert likeness.twins == {}
    assert likeness.session.hysteresis > 0


def test_short_session_is_not_measured(device):
    assert compare_with_twins(make_session("hysteretic", seconds=8.0), device) is None


def test_signals_without_ohms_have_no_noise_of_joints(device):
    in_ohm = compare_with_twins(make_session("viscoelastic"), device)
    plain = compare_with_twins(make_session("viscoelastic", unit=False), device)
    noise = [likeness.twins["viscoelastic"][1].noise for likeness in (in_ohm, plain)]
    assert noise[1] < 1.2 * noise[0]
