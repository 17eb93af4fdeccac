"""Test voltage dividers: counts, resolution, and the table of the firmware's page."""

import re

import numpy as np
import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.sensing.voltage_divider import (
    Dividers,
    choose_reference,
    measure_reference,
    reference_resistors,
)
from tests.support.errors import raises
from tests.support.places import FIRMWARE

PAGE = FIRMWARE / "README.md"


def test_counts_and_resistances_are_inverse():
    d = Dividers(np.array([1000.0, 2200, 10000]), 1024)
    ohm = np.array([[500.0, 2200, 8000], [30, 9000, 40000]])
    assert d.resistance(d.counts(ohm)) == pytest.approx(ohm)
    assert d.counts(np.array([1000.0, 2200, 10000])) == pytest.approx([512] * 3)


def test_ends_of_the_range():
    d = Dividers(np.full(4, 1000.0), 1024)
    resistance = d.resistance(np.array([0, 1023.5, 512, np.nan]))
    assert resistance == pytest.approx([0, np.inf, 1000, np.nan], nan_ok=True)


def test_resolution_is_the_derivative():
    """The resolution is 14 ohm per count for 2.1 kohm with 10 kohm and 10 bits."""
    d = Dividers(np.array([10_000.0]), 1024)
    assert d.resolution(2100.0)[0] == pytest.approx(14.3, abs=0.05)
    step = d.resistance(d.counts(np.array([2100.0])) + 0.5) - d.resistance(
        d.counts(np.array([2100.0])) - 0.5
    )
    assert d.resolution(2100.0) == pytest.approx(step, rel=1e-3)


def test_best_reference_equals_the_cord():
    refs = np.geomspace(500, 10_000, 200)
    finest = refs[[Dividers(np.array([r]), 1024).resolution(2200.0)[0] for r in refs].index(
        min(Dividers(np.array([r]), 1024).resolution(2200.0)[0] for r in refs))]  # fmt: skip
    assert finest == pytest.approx(2200, rel=0.02)
    assert choose_reference(2200, 2200) == 2200
    assert choose_reference(2000, 2600) == 2200


def test_table_of_the_page_is_computed():
    rows = [
        [cell.strip() for cell in line.strip("| \n").split("|")]
        for line in PAGE.read_text("utf-8").splitlines()
        if re.match(r"\| (cord at rest|\d+ \| (own|ADS))", line)
    ]
    refs = [float(r) for r in rows[0][2:]]
    assert len(rows) == 11
    for ohm, converter, *cells in rows[1:]:
        full = 1024 if converter.startswith("own") else 26400
        expected = [Dividers(np.array([r]), full).resolution(float(ohm))[0] for r in refs]
        assert [float(c) for c in cells] == pytest.approx(expected, rel=0.06)


def test_references_are_measured_with_a_known_resistor():
    true = np.array([2150.0, 2203, 2248])
    counts = Dividers(true, 1024).counts(np.full(3, 2000.0))
    assert measure_reference(counts, 2000, 1024) == pytest.approx(true)
    counts[1] = 1023.9
    with raises(CaptureError, "channels-unreadable", channels=[2]):
        measure_reference(counts, 2000, 1024)
    with raises(CaptureError, "not-positive", field="reference"):
        Dividers(np.array([0.0]), 1024)


def test_one_reference_resistor_is_that_of_all_channels():
    assert reference_resistors((1500.0,), 3) == [1500.0] * 3
    assert reference_resistors((1.0, 2.0), 2) == [1.0, 2.0]
    with raises(CaptureError, "resistance-count-differs", count=2):
        reference_resistors((1.0, 2.0), 3)
