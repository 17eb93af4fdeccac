"""The converter of a simulated board: whole counts, and continuous values without steps."""

import numpy as np
import pytest

from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.twin.electronics.readout_board import BoardTraits, Converter
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
