"""Names and units of columns."""

from __future__ import annotations

import math

import pytest

from defsense_fab.training.recordings.column_units import find_time, parse_column


@pytest.mark.parametrize(
    ("header", "name", "unit", "factor"),
    [
        ("angle_deg", "angle", "deg", 1),
        ("angle [rad]", "angle", "deg", 180 / math.pi),
        ("knee flexion (°)", "knee flexion", "deg", 1),
        ("p0_x_mm", "p0_x", "mm", 1),
        ("stretch_cm", "stretch", "mm", 10),
        ("stretch [m]", "stretch", "mm", 1000),
        ("force_N", "force", "N", 1),
        ("force_mN", "force", "mN", 1),
        ("left_kohm", "left", "ohm", 1e3),
        ("left [kΩ]", "left", "ohm", 1e3),
        ("cap_nF", "cap", "pF", 1e3),
        ("out_mV", "out", "V", 1e-3),
        ("adc0_counts", "adc0", "counts", 1),
        ("s1 [(R-R0)/R0]", "s1", "(R - R0)/R0", 1),
        ("speed [furlong]", "speed", "furlong", 1),
        ("adc0_data3", "adc0_data3", "", 1),
        ("wait_ms", "wait_ms", "", 1),
        ("s1", "s1", "", 1),
    ],
)
def test_units_are_taken_from_headers(header, name, unit, factor):
    column = parse_column(header)
    assert (column.name, column.unit) == (name, unit)
    assert column.factor == pytest.approx(factor)


@pytest.mark.parametrize(
    ("header", "seconds"),
    [("time", 1), ("Time [s]", 1), ("t", 1), ("time_ms", 1e-3), ("timestamp (us)", 1e-6)],
)
def test_times_are_found_in_any_unit(header, seconds):
    assert find_time(("a", header)) == (header, pytest.approx(seconds))


def test_columns_without_times_are_no_times():
    assert find_time(("a", "timer", "time_deg")) is None
