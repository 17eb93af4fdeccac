"""The converters of simulated boards: whole counts, or continuous values without steps."""

import numpy as np
import pytest

from defsense_fab.sensing.response import Response
from defsense_fab.sensing.serial_frames import Info, Stream
from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.twin.electronics.cords import CordTraits, SpecimenTwin
from defsense_fab.twin.electronics.readout_board import BoardTraits, Converter, ReadoutTwin
from defsense_fab.twin.scenes.assumptions import disable_traits

OHM = np.linspace(1000.0, 1400.0, 4000)[:, None]


def converter(traits):
    return Converter.from_traits(traits, 1023, 16, np.array([1100.0]))


def convert(traits):
    one = converter(traits)
    sums = one.convert(OHM, traits.own_noise, np.random.default_rng(0))
    return one.to_resistances(sums)


def test_steps_are_those_of_the_divider():
    """Without noise a conversion is off by up to half a step; noise and averages reduce that."""
    silent = BoardTraits(own_noise=0.0)
    step = Dividers(np.array([1100.0]), 1023).resolution(OHM)
    error = np.abs(convert(silent) - OHM)
    assert (error <= 0.51 * step).all()
    assert error.max() > 0.4 * step.max()
    assert len(np.unique(convert(silent))) < 90
    assert np.std(convert(BoardTraits()) - OHM) < 0.6 * np.std(convert(silent) - OHM)


def test_values_are_continuous_without_steps():
    continuous = disable_traits(BoardTraits(), {"quantisation"})
    assert convert(continuous) == pytest.approx(OHM, rel=1e-6)
    assert converter(continuous).averages == 1


@pytest.mark.parametrize(
    ("converter", "code", "full_scale"),
    [("arduino", 0, 1024), ("pico", 0, 4096), ("esp32", 0, 3300), ("ads1115", 1, 26400)],
)
def test_boards_describe_their_converter(converter, code, full_scale):
    cords = SpecimenTwin(CordTraits(Response.line(2.0)), np.random.default_rng(0))
    board = ReadoutTwin(cords, converter=converter)
    board.write(b"frames\n")
    info = next(m for m in Stream().feed(board.read(4096)) if isinstance(m, Info))
    assert (info.converter, info.full_scale) == (code, full_scale)
