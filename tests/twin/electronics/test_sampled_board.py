"""The twin's converter: whole counts, and none where its steps are switched off."""

import numpy as np
import pytest

from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.twin.electronics.readout_board import BoardTraits, Converter
from defsense_fab.twin.scenes.assumptions import disable_traits

OHM = np.linspace(1000.0, 1400.0, 4000)[:, None]


def converter(traits):
    return Converter.of(traits, 1023, 16, np.array([1100.0]))


def read(traits):
    made = converter(traits)
    return made.resistances(made.sums(OHM, traits.own_noise, np.random.default_rng(0)))


def test_steps_are_those_of_the_divider():
    """Without noise one conversion is off by half a step at most; noise and averages even steps
    out."""
    silent = BoardTraits(own_noise=0.0)
    step = Dividers(np.array([1100.0]), 1023).resolution(OHM)
    off = np.abs(read(silent) - OHM)
    assert (off <= 0.51 * step).all()
    assert off.max() > 0.4 * step.max()
    assert len(np.unique(read(silent))) < 90
    assert np.std(read(BoardTraits()) - OHM) < 0.6 * np.std(read(silent) - OHM)


def test_without_steps():
    fine = disable_traits(BoardTraits(), {"quantisation"})
    assert read(fine) == pytest.approx(OHM, rel=1e-6)
    assert converter(fine).averages == 1
