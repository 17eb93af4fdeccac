"""Test fits of known responses: values, choice of the model, interval, and the neutral cord."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.calibration.calibrate import calibrate
from defsense_fab.calibration.model_selection import compare_models
from defsense_fab.calibration.options import FitOptions
from defsense_fab.calibration.reading_checks import find_drift
from defsense_fab.calibration.readings import (
    PLAY_HALF_WIDTHS,
    Geometry,
    Memory,
    hysteresis_half_width,
    join_readings,
)
from defsense_fab.calibration.response_fit import FitData, build_model, fit_model
from defsense_fab.core.errors import CalibrationError
from defsense_fab.sensing.response import build_response
from tests.calibration.ideal_readings import make_readings
from tests.support.errors import raises

LINE = (lambda e: 2 * e, "line")
QUADRATIC = (lambda e: 2 * e + 8 * e * e, "quadratic")
TWO_SLOPES = (lambda e: (2.4 if e > 0 else 1.6) * e, "two-slopes")
CUBIC = (lambda e: 2 * e + 4 * e * e - 100 * e**3, "cubic")
#: Saturates in tension at 12 %.
STEP = (lambda e: 0.12 * np.tanh(2.5 * e / 0.1) + 0.02 * np.sin(90 * e), "piecewise")


def test_piecewise_response_may_fall():
    falling = calibrate(
        make_readings(lambda e: -STEP[0](e), noise=0.0005, rounds=3),
        FitOptions(model="piecewise"), draws=3,
    )  # fmt: skip
    e = np.linspace(-0.066, 0.066, 21)
    expected = [-STEP[0](x) for x in e]
    assert build_response(falling.response)(e) == pytest.approx(expected, abs=0.015)
    assert falling.k_res < 0


def test_strains_equal_those_of_the_paper():
    """METHOD: 6.7 % at 75 mm and 2.1 % at 250 mm, thickness 15, offset 2."""
    g = Geometry(15, 2)
    assert g.strain(75, 1) == pytest.approx(5.5 / 82.5)
    assert g.strain(250, -1) == pytest.approx(-5.5 / 257.5)
    assert g.strain(75, 0) == g.strain(float("nan"), 1) == 0


@pytest.mark.parametrize(("true", "name"), [LINE, QUADRATIC, TWO_SLOPES, CUBIC])
def test_exact_readings_reproduce_the_response(true, name):
    result = calibrate(make_readings(true, noise=0), draws=30)
    assert result.response.model == name
    e = np.linspace(-0.066, 0.066, 21)
    assert build_response(result.response)(e) == pytest.approx([true(x) for x in e], abs=2e-5)
    assert result.k_res == pytest.approx(2.0, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("both", [False, True])
@pytest.mark.parametrize(("true", "name"), [LINE, QUADRATIC, TWO_SLOPES, CUBIC, STEP])
def test_model_choice(true, name, both):
    """The right model is chosen in at least three of four sessions, despite noise and gains."""
    rounds = 3 if name == "piecewise" else 1
    chosen = [
        calibrate(make_readings(true, seed, spread=0.02, both=both, rounds=rounds), draws=3)
        .response.model for seed in range(4)
    ]  # fmt: skip
    assert chosen.count(name) >= 3


def test_different_pieces_are_not_taken_for_asymmetry():
    """If specimens are not turned over, a top cord with a higher gain looks like tension."""
    chosen = [
        calibrate(make_readings(LINE[0], seed, spread=0.04), draws=3).response.model
        for seed in range(4)
    ]
    assert chosen.count("line") >= 3


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.0, 0.05])
def test_interval_covers_the_truth(spread):
    """At most one of six intervals misses, and they are not wider than necessary."""
    result = [calibrate(make_readings(LINE[0], s, spread=spread), draws=10) for s in range(6)]
    is_covered = [f.uncertainty.interval[0] <= 2.0 <= f.uncertainty.interval[1] for f in result]
    assert sum(is_covered) >= 5
    half = np.median(
        [(f.uncertainty.interval[1] - f.uncertainty.interval[0]) / 2 / f.k_res for f in result]
    )
    assert 0.03 < half < 0.12


@pytest.mark.slow
def test_six_specimens_need_no_assumed_spread():
    """No spread is assumed, so pieces that agree give a narrow interval."""
    is_covered = []
    for seed in range(4):
        r = make_readings(LINE[0], seed, specimens="abcdef", both=True, rounds=2)
        result = calibrate(r, draws=10)
        assert result.uncertainty.assumed == 0
        low, high = result.uncertainty.interval
        assert high - low < 0.04
        is_covered.append(low <= 2 <= high)
    assert sum(is_covered) >= 3


def test_outlier_has_little_weight():
    r = make_readings(LINE[0], rounds=2)
    clean = calibrate(r, draws=3).k_res
    r.resistance[5] *= 1.3
    assert calibrate(r, draws=3).k_res == pytest.approx(clean, rel=0.01)


def test_memory_is_separated_from_the_response():
    """Play and creep are fitted, in a random order of jigs."""
    rng = np.random.default_rng(0)
    strain = np.concatenate([[0], rng.permutation(np.repeat(np.linspace(-0.06, 0.06, 13), 6))])
    memory, time = Memory(), 30.0 * np.arange(len(strain))
    past = np.array([memory.at(e, t, t + 20) for e, t in zip(strain, time, strict=True)])
    true = np.array([0.0, 1.2, 0.0, 0.05, 0.1])
    y = 2 * strain + past @ true + 0.0001 * rng.normal(size=len(strain))
    result = fit_model(
        FitData(y, strain, np.zeros(len(y), int), 1, past), build_model("line", strain), 0.03
    )
    assert result.theta[0] == pytest.approx(2.0, abs=0.02)
    assert result.memory @ past.T == pytest.approx(true @ past.T, abs=5e-4)
    assert hysteresis_half_width(result.memory) == pytest.approx(
        1.2 * PLAY_HALF_WIDTHS[1], abs=6e-4
    )


def test_plays_lag_behind_the_strain():
    """They lag by at most their half widths, and change only after the strain has turned."""
    memory = Memory()
    up = np.array([memory.at(e, 0, 0)[: len(PLAY_HALF_WIDTHS)] for e in np.linspace(0, 0.05, 51)])
    assert up[-1] == pytest.approx(-PLAY_HALF_WIDTHS)
    down = np.array([memory.at(e, 0, 0)[: len(PLAY_HALF_WIDTHS)] for e in (0.049, 0.045, 0.0)])
    assert down[0] == pytest.approx([0.0, -0.002, -0.008])
    assert down[2] == pytest.approx(PLAY_HALF_WIDTHS)


def test_left_out_errors_equal_those_of_refits():
    """For a line, each radius is predicted from a least-squares fit to the others."""
    r = make_readings(LINE[0], specimens=("150",), noise=0.002)
    is_outer = ~r.neutral
    y, strain, piece, radius = (a[is_outer] for a in (r.changes(), r.strain, r.piece, r.radius))
    data = FitData(y, strain, piece, 3, r.memory[is_outer])
    trial = compare_models(data, radius, 0.0)["line"]
    errors = []
    for one in np.unique(radius[~np.isnan(radius)]):
        others = radius != one
        A = np.stack([strain, piece == 0, piece == 2], axis=1)
        x = np.linalg.lstsq(A[others], y[others], rcond=None)[0]
        errors.append(((A @ x - y)[~others] ** 2).mean())
    assert trial.left_out_rmse == pytest.approx(np.sqrt(np.mean(errors)), rel=0.05)


def test_drift_of_the_neutral_cord():
    r = make_readings(LINE[0], drift=0.005)
    with raises(CalibrationError, "neutral-cord-drifts") as caught:
        calibrate(r)
    assert 0.04 < caught.value.data["change"] < 0.05
    corrected = calibrate(r, FitOptions(neutral="correct"), draws=3)
    assert corrected.k_res == pytest.approx(2.0, rel=0.02)
    assert corrected.response.model == "line"
    assert corrected.warnings[0].code == "drift-corrected"
    ignored = calibrate(r, FitOptions(neutral="ignore"), draws=3)
    assert ignored.drift.is_significant
    assert ignored.warnings[0].code == "drift-ignored"


@pytest.mark.parametrize("noise", [0.001, 0.002, 0.005])
def test_noise_of_the_neutral_cord_is_not_drift(noise):
    result = [make_readings(LINE[0], seed, noise=noise) for seed in range(100)]
    assert sum(find_drift(r, r.changes(), noise).is_significant for r in result) <= 4


def test_each_source_has_its_own_rest_resistance():
    """In a specimen that is measured twice the cords have aged; its pieces are still two."""
    one, two = (make_readings(LINE[0], s, specimens=("a",)) for s in (0, 1))
    two = replace(two, resistance=1.02 * two.resistance)
    both = join_readings([one, two])
    assert len(both.pieces) == 6
    result = calibrate(both, draws=10)
    assert result.k_res == pytest.approx(2, rel=0.02)
    assert result.uncertainty.assumed == pytest.approx(1.96 * 0.03)
    assert "rest-differs" in [w.code for w in result.warnings]
    separate = calibrate(
        join_readings([one, make_readings(LINE[0], 1, specimens=("b",))]), draws=10
    )
    assert separate.uncertainty.assumed == pytest.approx(1.96 * 0.03 / np.sqrt(2))


def test_different_pieces_widen_the_interval():
    narrow, wide = (
        calibrate(make_readings(lambda e, t=t: (2 + t * np.sign(e)) * e, 3, specimens=("a",)),
                  FitOptions(model="line"), draws=10).uncertainty
        for t in (0.0, 0.2)
    )  # fmt: skip
    assert np.ptp(wide.interval) > 1.3 * np.ptp(narrow.interval)


def test_readings_that_cannot_be_fitted_are_refused():
    with raises(CalibrationError, "no-strain-response"):
        calibrate(make_readings(lambda e: 0 * e, noise=0))
    few = make_readings(LINE[0], radii=(75.0, 112.0, 200.0))
    with raises(CalibrationError, "too-few-radii", model="piecewise", count=3):
        calibrate(few, FitOptions(model="piecewise"))


def test_response_that_is_not_monotone_is_reported():
    result = calibrate(make_readings(lambda e: 2 * e + 22 * e * e, seed=1), draws=3)
    assert result.response.model == "quadratic"
    assert "response-not-monotone" in [w.code for w in result.warnings]
