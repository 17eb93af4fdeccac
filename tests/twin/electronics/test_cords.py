"""Simulated cords of a device."""

import numpy as np
import pytest

from defsense_fab.sensing.response import Response
from defsense_fab.twin.electronics.cords import CordTraits, DeviceCords

SILENT = CordTraits(Response.line(1.0), noise=0.0, play=0.0, healing=0.0, spread=0.0)


def test_cords_follow_the_signals_of_a_moving_device():
    cords = DeviceCords(
        ("a",),
        np.array([100.0]),
        lambda s: np.array([0.1 * np.sin(s)]),
        SILENT,
        np.random.default_rng(0),
    )
    time, ohm = cords.measure(3.0, 50)
    np.testing.assert_allclose(ohm[:, 0] / cords.rest[0] - 1, 0.1 * np.sin(time), atol=2e-4)
    assert cords.time == pytest.approx(3)
