"""Simulated cords of a moving device, and cords that replay a recording."""

import numpy as np
import pytest

from defsense_fab.sensing.response import Response
from defsense_fab.twin.electronics.cords import CordFault, CordTraits, DeviceCords, ReplayedCords

SILENT = CordTraits(Response.line(1.0), noise=0.0, play=0.0, healing=0.0, spread=0.0)


def test_cords_follow_the_signals_of_a_moving_device():
    cords = DeviceCords(
        ("a",),
        np.array([100.0]),
        lambda s: np.array([0.1 * np.sin(s)]),
        SILENT,
        np.random.default_rng(0),
    )
    step = 0.02
    starts = step * np.arange(150)
    ohm = np.array([cords.sample(start, step)[0] for start in starts])
    np.testing.assert_allclose(ohm / cords.rest[0] - 1, 0.1 * np.sin(starts + step), atol=2e-4)


def test_recording_is_replayed_forwards_and_backwards_with_faults():
    time, ohm = np.array([0.0, 10.0]), np.array([[1000.0, 500.0], [1100.0, 600.0]])
    faults = (
        CordFault("cut", (0,), 1.0, 2.0),
        CordFault("stuck", (1,), 4.0, 6.0),
        CordFault("swap", (0, 1), 7.0, 8.0),
        CordFault("short", (0,), 30.0),
    )
    cords = ReplayedCords(("a", "b"), time, ohm, faults)
    assert cords.sample(2.9, 0.1) == pytest.approx([1030, 530])
    assert cords.sample(16.9, 0.1) == pytest.approx([1030, 530])  # backwards
    assert cords.sample(1.4, 0.1) == pytest.approx([1e9, 515])
    assert cords.sample(3.9, 0.1) == pytest.approx([1040, 540])
    assert cords.sample(4.9, 0.1) == pytest.approx([1050, 540])
    assert cords.sample(7.4, 0.1) == pytest.approx([575, 1075])
    assert cords.sample(40.9, 0.1) == pytest.approx([1e-3, 510])
