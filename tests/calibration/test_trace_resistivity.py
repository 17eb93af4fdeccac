"""Fit of a filament's resistivities to readings of a coupon."""

import numpy as np
import pytest

from defsense_fab.calibration.trace_resistivity import CouponTrace, fit_resistivity
from defsense_fab.core.errors import CalibrationError
from tests.support.errors import raises

#: Level, level, upright, upright, and a slope that is not fitted: lengths per section, 1/mm.
TRACES = (
    CouponTrace("long", 62.0, 0.0, 7440.0),
    CouponTrace("short", 12.0, 0.0, 1440.0),
    CouponTrace("upright", 0.0, 14.0, 5040.0),
    CouponTrace("low", 0.0, 4.0, 1440.0),
    CouponTrace("slope", 8.0, 6.0, 3120.0, is_fitted=False),
)
SPREAD = 0.03


def readings(resistivity, between_layers, contact):
    along, between = (np.array([getattr(t, n) for t in TRACES]) for n in ("along", "between"))
    return resistivity * (along + between_layers * between) + 2 * contact


def test_exact_readings_give_the_numbers():
    fit = fit_resistivity(TRACES, np.arange(5), readings(90.0, 2.5, 40.0), SPREAD)
    assert fit.resistivity.value == pytest.approx(90.0)
    assert fit.between_layers.value == pytest.approx(2.5)
    assert fit.contact.value == pytest.approx(40.0)
    assert fit.suspect is None
    assert fit.spread == SPREAD  # not less, although the readings agree


def test_standard_errors_cover_the_scatter():
    """Over many coupons, the stated errors are those of the numbers."""
    rng, exact = np.random.default_rng(0), readings(90.0, 2.5, 200.0)
    trace = np.repeat(np.arange(5), 4)
    values, errors = [], []
    for _ in range(200):
        noisy = exact[trace] * (1 + SPREAD * rng.standard_normal(len(trace)))
        fit = fit_resistivity(TRACES, trace, noisy, SPREAD)
        numbers = (fit.resistivity, fit.between_layers, fit.contact)
        values.append([n.value for n in numbers])
        errors.append([n.error for n in numbers])
    assert np.mean(values, axis=0) == pytest.approx([90.0, 2.5, 200.0], rel=0.02)
    assert np.mean(errors, axis=0) == pytest.approx(np.std(values, axis=0), rel=0.3)


def test_an_odd_trace_is_named_and_widens_the_errors():
    trace, exact = np.repeat(np.arange(5), 3), readings(90.0, 2.5, 40.0)
    bad = exact[trace] * np.where(trace == 2, 1.4, 1.0) * np.tile([0.99, 1.0, 1.01], 5)
    good = exact[trace] * np.tile([0.99, 1.0, 1.01], 5)
    traces = (*TRACES, CouponTrace("upright-2", 0.0, 20.0, 7200.0))
    extra = 90.0 * 2.5 * 20.0 + 80.0
    trace, bad, good = np.append(trace, [5] * 3), np.append(bad, [extra] * 3), [*good, *[extra] * 3]
    odd = fit_resistivity(traces, trace, bad, SPREAD)
    assert traces[odd.suspect].name == "upright"
    even = fit_resistivity(traces, trace, np.array(good), SPREAD)
    assert even.suspect is None
    assert odd.resistivity.error > even.resistivity.error


def test_traces_that_are_not_fitted_change_nothing():
    exact = readings(90.0, 2.5, 40.0)
    exact[4] *= 2
    fit = fit_resistivity(TRACES, np.arange(5), exact, SPREAD)
    assert fit.resistivity.value == pytest.approx(90.0)
    assert fit.deviation[4] == pytest.approx(1.0)


@pytest.mark.parametrize("kept", [(0, 1), (0, 1, 4), (2, 3, 4), ()])
def test_too_few_traces_are_refused(kept):
    trace = np.array(kept, int)
    with raises(CalibrationError, "too-few-traces"):
        fit_resistivity(TRACES, trace, readings(90.0, 2.5, 40.0)[trace], SPREAD)


def test_readings_in_the_wrong_order_are_refused():
    with raises(CalibrationError, "readings-inconsistent"):
        fit_resistivity(TRACES, np.array([0, 1, 2, 3]), np.array([10.0, 9e3, 5e3, 9e3]), SPREAD)
