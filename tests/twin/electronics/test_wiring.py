"""Wires with faults: voltages of pins by Kirchhoff's law, and what a converter makes of them."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.sensing.serial_frames import MAX_COUNT, NOT_READ
from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.twin.electronics.fault_words import parse_faults
from defsense_fab.twin.electronics.wiring import WIRING_KINDS, Wiring, WiringTraits

NAMES = ("left", "right")
OHM = np.array([800.0, 1500.0])
REFERENCE = np.array([1000.0, 1000.0])


def read(*words, converter=0, ohm=OHM, samples=200, moved=None, averages=16):
    """Return the counts (n, 2) of conversions in samples at 100 Hz."""
    full_scale = 26400 if converter else 1024
    wiring = Wiring(
        WiringTraits(converter, full_scale, REFERENCE),
        parse_faults(NAMES, words, WIRING_KINDS),
        np.random.default_rng(3),
    )
    wiring.moved = moved
    rows = [wiring.convert(ohm, k / 100, averages, 2) for k in range(1, samples + 1)]
    return np.array(rows) / averages


def resistances(counts, full_scale=1024):
    return Dividers(REFERENCE, full_scale).resistance(counts.mean(axis=0))


def test_sound_wires_read_the_cords():
    # Reference resistors have a tolerance of 1 %, normally distributed.
    assert resistances(read()) == pytest.approx(OHM, rel=0.05)


def test_swap_exchanges_cords_and_not_resistors():
    assert resistances(read("swap=left+right")) == pytest.approx(OHM[::-1], rel=0.05)


def test_cut_and_short_reach_the_ends_of_the_range():
    counts = read("cut=left", "short=right")
    assert counts[:, 0].min() > 1022
    assert counts[:, 1].max() < 1.5


def test_bridge_makes_voltages_equal():
    counts = read("bridge=left+right*0.1").mean(axis=0)
    assert counts[0] == pytest.approx(counts[1], abs=0.1)
    parallel = 1 / (1 / OHM).sum()  # of both cords, against both resistors
    assert counts[0] == pytest.approx(1024 * parallel / (parallel + 500), rel=0.02)


def test_wrong_resistor_and_additional_resistance():
    assert resistances(read("reference=left*10"))[0] == pytest.approx(80, rel=0.05)
    assert resistances(read("series=left*400"))[0] == pytest.approx(1200, rel=0.05)


@pytest.mark.parametrize(("word", "hertz"), [("hum50=left*50", 50), ("hum60=left*50", 60)])
def test_hum_has_the_frequency_of_the_mains(word, hertz):
    wiring = Wiring(
        WiringTraits(0, 1024, REFERENCE), parse_faults(NAMES, [word], WIRING_KINDS),
        np.random.default_rng(3),
    )  # fmt: skip
    counts = np.array([wiring.convert(OHM, k / 400, 4, 2)[0] / 4 for k in range(1, 801)])
    spectrum = np.abs(np.fft.rfft(counts - counts.mean()))
    assert np.fft.rfftfreq(len(counts), 1 / 400)[spectrum.argmax()] == pytest.approx(hertz, abs=1)


def test_loose_contact_acts_while_its_wire_is_moved():
    still, moved = read("loose=left*300"), read("loose=left*300", moved=0)
    assert np.ptp(moved[:, 0]) > 10 * np.ptp(still[:, 0])
    other = read("loose=left*300", moved=1)
    assert np.ptp(other[:, 0]) < 2 * np.ptp(still[:, 0])


def test_supply_drives_a_converter_with_its_own_reference_to_its_end():
    counts = read("supply=left*1.52", converter=1, ohm=np.array([1e6, 1000.0]), averages=1)
    assert (counts[:, 0] == MAX_COUNT).all()
    assert counts[:, 1].mean() == pytest.approx(1.52 * 13200, rel=0.03)


def test_unread_channel_has_no_sum():
    counts = read("unread=right", averages=1)
    assert (counts[:, 1] == NOT_READ).all()
    assert (counts[:, 0] < 1024).all()
