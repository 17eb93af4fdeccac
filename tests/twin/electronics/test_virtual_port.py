"""Virtual ports of simulated boards."""

import time

import numpy as np
import pytest

from defsense_fab.capture.readout.ports import open_port
from defsense_fab.capture.readout.reader import Reader, ReadoutSettings
from defsense_fab.sensing.response import Response
from defsense_fab.twin.electronics.cords import CordTraits, DeviceCords
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.twin.electronics.virtual_port import PseudoTerminal, SocketPort

SILENT = CordTraits(Response.line(1.0), noise=0.0, play=0.0, healing=0.0, spread=0.0)


@pytest.mark.parametrize("kind", [PseudoTerminal, SocketPort])
def test_reader_opens_a_virtual_port_like_a_serial_port(kind):
    rng = np.random.default_rng(0)
    cords = DeviceCords(("a", "b"), np.array([100.0, 80.0]), lambda s: np.zeros(2), SILENT, rng)
    board = ReadoutTwin(cords, 1500.0, offset=5.0)
    line = kind(board)
    settings = ReadoutSettings(channels=2, rate=50, led=100)
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
