"""Test built cords: bonded, held with prestretch, and diluted by cord that is not stretched."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.response import ResponseSpec
from defsense_fab.sensing.built_cord import (
    PRESTRETCH_SPREAD,
    BuiltCord,
    CordReading,
    TraceSection,
    held_response,
    quantization_noise,
    required_prestretch,
    scale_response,
    taut_response,
)
from defsense_fab.sensing.response import Response, build_response

PATH = np.linspace([0.0, 0, 0], [100, 0, 0], 51)
MODELS = {
    "line": {"k": 1.8},
    "two-slopes": {"tension": 2.2, "compression": 0.7},
    "quadratic": {"k": 2.0, "q": 3.0},
    "piecewise": {"strains": [-0.05, -0.02, 0, 0.04, 0.3], "changes": [-0.06, -0.03, 0, 0.1, 0.5]},
}


@pytest.fixture(params=MODELS)
def response(request):
    return build_response(ResponseSpec(request.param, MODELS[request.param], (-0.1, 0.4)))


def ohm(response, rest, strain, per_mm=14.5):
    """Return the resistance of `rest` mm of loose cord at a strain."""
    return per_mm * rest * (1 + float(response(np.array(strain))))


@pytest.mark.parametrize("p", [0.0, 0.05, 0.2])
def test_held_cord_equals_a_loose_one_stretched_twice(response, p):
    """Resistances follow from the cord's own strain, which is never negative."""
    reading = CordReading(response, 14.5, 0.002, 1.0)
    cord, loose = BuiltCord(PATH, 30.0, p), 100 / (1 + p)
    rest = ohm(response, loose, p) + 14.5 * 30
    assert reading.resistance(cord) == pytest.approx(rest)
    for e in (-0.3, -0.08, -0.02, 0.0, 0.03, 0.15):
        now = ohm(response, loose, max((1 + p) * (1 + e) - 1, 0.0)) + 14.5 * 30
        bent = (PATH * [1 + e, 1, 1])[None]
        assert reading.signals(cord, bent)[0] == pytest.approx(now / rest - 1, abs=1e-12)


def test_taut_response_continues_along_its_tangent(response):
    """It equals the held response above zero strain, and has no kink there."""
    e, start = np.linspace(-0.3, 0.4, 71), 1 / 1.1 - 1
    taut, real = taut_response(response, 0.1), held_response(response, 0.1)
    assert taut(e[e > start]) == pytest.approx(real(e[e > start]), abs=1e-12)
    below = e[e < start]
    slope = taut.slope(np.array(start + 1e-9))
    assert taut(below) == pytest.approx(taut(np.array(start)) + slope * (below - start), abs=1e-7)
    assert real(below) == pytest.approx(real(np.array(start)) * np.ones(len(below)))


def test_bonded_cord_follows_local_strain(response):
    """Half of it is stretched, half compressed; a held cord of equal length has no signal."""
    x = PATH[:, 0]
    moved = PATH.copy()
    moved[:, 0] = np.where(x <= 50, 1.04 * x, 52 + 0.96 * (x - 50))
    reading = CordReading(response, 14.5, 0.002, 1.0)
    expected = (response(np.array(0.04)) + response(np.array(-0.04))) / 2
    bonded = BuiltCord(PATH, 0.0, None)
    assert reading.signals(bonded, moved[None])[0] == pytest.approx(float(expected), abs=1e-12)
    assert reading.signals(BuiltCord(PATH, 0.0, 0.05), moved[None])[0] == pytest.approx(0, abs=1e-9)


def test_free_ends_dilute_and_short_cords_are_noisy():
    reading = CordReading(Response.line(2.0), 14.5, 0.002, 1.0)
    bent = (PATH * [1.05, 1, 1])[None]
    whole, diluted = (BuiltCord(PATH, series, None) for series in (0.0, 40.0))
    assert reading.signals(whole, bent)[0] == pytest.approx(0.1)
    assert reading.signals(diluted, bent)[0] == pytest.approx(0.1 / 1.4)
    short = BuiltCord(PATH / 4, 0.0, None)
    assert reading.noise(short) == pytest.approx(np.sqrt(0.002**2 + 2 / (25 * 14.5) ** 2))
    assert reading.noise(short) > 1.9 * reading.noise(whole)
    assert replace(reading, contact=0.0).noise(short) == 0.002


@pytest.mark.parametrize("least", [0.03, 0.0, -0.002, -0.01, -0.1, -0.4])
def test_required_prestretch_keeps_the_cord_taut(least):
    p, spare = required_prestretch(least), 2 * PRESTRETCH_SPREAD
    assert (1 + p - spare) * (1 + 1.1 * min(least, 0.0)) - 1 >= -1e-9
    assert 0 <= p - spare <= 1 / (1 + 1.1 * min(least, 0.0)) - 1 + 0.01
    assert 100 * p == pytest.approx(round(100 * p))


def test_scaled_response_below_zero(response):
    other = scale_response(response, 1.1, 0.5)
    e = np.linspace(-0.2, 0.3, 51)
    expected = 1.1 * response(e) * np.where(e < 0, 0.5, 1.0)
    assert other(e) == pytest.approx(expected, abs=1e-12)


def test_quantization_noise_by_sampling():
    """Conversions with dither are rounded in a matched divider, for 5000 cords."""
    rng = np.random.default_rng(0)
    true = rng.uniform(900, 1100, 5000)
    share = true / (true + 1000)
    one = np.round(share[:, None] * 1023 + rng.uniform(-0.5, 0.5, (5000, 16))).mean(1) / 1023
    off = 1000 * one / (1 - one) / true - 1
    # The dither itself adds as much again as the steps do.
    assert off.std() == pytest.approx(np.sqrt(2) * quantization_noise("arduino"), rel=0.05)
    assert quantization_noise("ads1115") < quantization_noise("arduino") / 5


@pytest.mark.parametrize(
    ("direction", "expected"),
    [
        ((1, 0, 0), 1.0),
        ((0, -3, 0), 1.0),
        ((0, 0, 2), 3.0 * 0.8 / (np.pi / 4 * 1.2)),  # from layer to layer, through a disc
        ((0, 0, -2), 3.0 * 0.8 / (np.pi / 4 * 1.2)),
        ((1, 0, 1), 2.0 * 0.8 * np.sqrt(2) / (0.8 + np.pi / 4 * 1.2)),
    ],
)
def test_a_trace_conducts_by_its_direction(direction, expected):
    """Between level and vertical, both resistivities count by the squared cosines."""
    section = TraceSection(1.2, 0.8, np.array([0.0, 0.0, 1.0]), 3.0)
    path = np.array([[1.0, 2, 3], np.add((1.0, 2, 3), direction)])
    assert section.relative_resistance(path)[0] == pytest.approx(expected, rel=0.01)


def test_a_trace_that_is_nearly_level_conducts_like_a_level_one():
    """There is no kink, so that searches have continuous derivatives."""
    section = TraceSection(1.2, 0.8, np.array([0.0, 0.0, 1.0]), 3.0)
    rises = np.array([-1e-4, 1e-4])
    paths = [np.array([[0.0, 0, 0], [1, 0, rise]]) for rise in rises]
    for path in paths:
        assert section.relative_resistance(path)[0] == pytest.approx(1.0, abs=1e-6)


def test_a_trace_has_the_resistance_of_its_segments():
    section = TraceSection(1.2, 0.8, np.array([0.0, 0.0, 1.0]), 3.0)
    reading = CordReading(Response.line(2.0), 125.0, 0.003, 50.0, section)
    path = np.array([[0.0, 0, 0], [60, 0, 0], [60, 0, 20]])
    vertical = 3.0 * 0.8 / (np.pi / 4 * 1.2)
    ohm = 125.0 * (60 + 20 * vertical)
    trace = BuiltCord(path, 0.0, None)
    assert reading.resistance(trace) == pytest.approx(ohm)
    stretched = (path * [1.1, 1, 1])[None]
    assert reading.signals(trace, stretched)[0] == pytest.approx(0.2 * 60 * 125 / ohm)
