"""Cords that a joint stretches while it is open."""

from types import SimpleNamespace

import numpy as np
from defsense_fab.optimize.prediction.assembly_effects import (
    least_across,
    LEAST_OPEN,
    overstretched,
)

from defsense_fab.core.device.device_file import load_device
from defsense_fab.sensing.built_cord import BuiltCord
from tests.support.places import BAR


def told(length, wires, joints=2, pocket=7.0):
    """Of a cord of so many mm between its ferrules, in so many joints."""
    ends = [SimpleNamespace(wire=w, pocket=pocket) for w in wires]
    cuts = [SimpleNamespace(cords=(0,), wires=()) for _ in range(joints)]
    made = SimpleNamespace(channels=[SimpleNamespace(name="a", ends=ends)], cuts=cuts)
    path = np.array([[0.0, 0, 0], [length, 0, 0]])
    return overstretched(load_device(BAR), made, [BuiltCord(path, 0.0, 0.05)])


def test_a_cord_held_at_both_ends_takes_an_open_joint_if_it_is_long_enough():
    device = load_device(BAR)
    most = device.cord.max_strain
    just = 1.05 * LEAST_OPEN / (most - 0.05)
    assert told(1.01 * just, ("bend", "bend")) == []
    (text,) = told(0.99 * just, ("bend", "bend"))
    assert text.startswith("cord a is short and lies in several joints: while one of them is open")
    assert told(0.99 * just, ("bend", "bend"), joints=1) == []
    assert least_across(device) > just  # which does not know how far it will be stretched


def test_a_cord_with_an_end_that_waits_is_pulled_out_of_its_mouth():
    device = load_device(BAR)
    reach = device.cord.ferrule_length / 2 + 5.0
    just = 1.05 * (7.0 - device.cord.ferrule_length / 2 + reach) / (device.cord.max_strain - 0.05)
    assert told(1.01 * just, ("bend", "mouth")) == []
    (text,) = told(0.99 * just, ("bend", "mouth"))
    assert "as its last end is crimped outside of its mouth" in text
    assert f"more than its {device.cord.max_strain:.0%}" in text
    assert told(10.0, ("bend", "bend"), joints=0) == []
