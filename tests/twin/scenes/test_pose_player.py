"""Hands that show poses, cords that are read while they move, and the line to the board."""

import time

import numpy as np
import pytest

from defsense_fab.capture.readout.ports import open_port
from defsense_fab.capture.readout.reader import Reader, Settings
from defsense_fab.sensing.response import Response
from defsense_fab.twin.electronics.cords import CordTraits, DeviceCords
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.twin.electronics.virtual_port import PseudoTerminal, SocketPort
from defsense_fab.twin.scenes.device_motion import PosePlayer, Ramp

RAMPS = [
    Ramp("bend", np.array([0.5, 1.0]), np.array([0, 1])),
    Ramp("twist", np.array([1.0]), np.array([2])),
]
QUIET = CordTraits(Response.line(1.0), noise=0.0, play=0.0, healing=0.0, spread=0.0)


def test_a_pose_begins_and_ends_at_rest():
    puppet = PosePlayer(RAMPS)
    puppet.perform("bend", 10.0, 8.0)
    puppet.perform("free", 20.0, 6.0)
    times = np.arange(9.0, 27.0, 0.02)
    bend = np.array([puppet.levels(t)["bend"] for t in times])
    twist = np.array([puppet.levels(t)["twist"] for t in times])
    during = (times > 10) & (times < 18)
    assert bend[during].max() > 0.85
    assert not twist[during].any()
    assert not bend[(times < 10.3) | ((times > 18) & (times < 20.3))].any()
    assert np.maximum(bend, twist)[times > 20].max() > 0.3
    assert np.abs(np.diff(bend)).max() < 0.05
    assert puppet.weights(9.0).tolist() == [0, 0, 0]
    assert puppet.weights(12.0).any()


def test_cords_follow_the_device_in_time():
    cords = DeviceCords(
        ("a",), np.array([100.0]), lambda s: np.array([0.1 * np.sin(s)]), QUIET,
        np.random.default_rng(0),
    )  # fmt: skip
    when, ohm = cords.hold(3.0, 50)
    np.testing.assert_allclose(ohm[:, 0] / cords.rest[0] - 1, 0.1 * np.sin(when), atol=2e-4)
    assert cords.now == pytest.approx(3)


@pytest.mark.parametrize("kind", [PseudoTerminal, SocketPort])
def test_a_board_on_a_line_is_read_as_on_a_port(kind):
    cords = DeviceCords(
        ("a", "b"), np.array([100.0, 80.0]), lambda s: np.zeros(2), QUIET, np.random.default_rng(0)
    )
    board = ReadoutTwin(cords, 1500.0, offset=5.0)
    line = kind(board)
    settings = Settings(channels=2, rate=50, led=100)
    try:
        with Reader(lambda: open_port(line.port), line.port, settings) as reader:
            until = time.monotonic() + 20
            while reader.statistics.samples < 40 and time.monotonic() < until:
                time.sleep(0.05)
            assert reader.statistics.samples >= 40
            assert reader.statistics.lost == reader.statistics.bad == 0
            stamped = reader.read_latest(2.0)
            assert stamped.sample.micros / 1e6 > 5
    finally:
        line.close()
