"""Compare the predicted band with devices simulated frame by frame and trained by a library."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import Ridge

from defsense_fab.core.curve import catmull_rom, sample_path
from defsense_fab.decoding.expected_errors import HELD_OUT, NONE, UnseenStates
from defsense_fab.optimization.refinement.refine import layout_error
from defsense_fab.optimization.studies.tolerance_monte_carlo import (
    ToleranceBand,
    Tolerances,
    measure_devices,
    sample_built_cord,
    sample_devices,
)
from defsense_fab.sensing.built_cord import BuiltCord, CordReading
from defsense_fab.sensing.memory_residual import MemoryResidual
from defsense_fab.sensing.response import Response, cord_signals

TWISTS = np.array([-1, -0.5, 0.5, 1])  # of the states of `problem`
EXACT = Tolerances(offset=0, gauge=0, amplitude=0, ends=0, compression=0)


def band_of(problem, layout, rng, unseen, memory=None, **options):
    """Return the band of bonded cords that sense on their whole length, with ideal joints."""
    cords = [BuiltCord(sample_path(s), 0.0, None) for s in layout]
    reading = CordReading(problem.sense.response, 14.5, problem.noise, 0.0)
    options = {"tolerances": Tolerances(compression=0)} | options
    devices = sample_devices(problem, cords, reading, rng, unseen, **options)
    return ToleranceBand.of(measure_devices(devices, problem.decoder, unseen, memory))


def every(problem):
    """Return folds that train and test on all states."""
    k = np.arange(len(problem.markers))
    return UnseenStates(NONE, ((k, k),), ((k[1:], TWISTS),))


def test_the_resistance_of_built_traces_changes_their_noise_alone(problem, straight):
    cord = BuiltCord(sample_path(straight("a")), 0.0, None)
    reading = CordReading(problem.sense.response, 125.0, 0.003, 50.0)
    tolerances, rng = replace(EXACT, resistance=0.15), np.random.default_rng(0)
    built = [sample_built_cord(cord, reading, rng, tolerances)[1] for _ in range(400)]
    ohm = np.array([b.resistance(cord) for b in built]) / reading.resistance(cord)
    assert ohm.std() == pytest.approx(0.15, rel=0.15)
    for one, ratio in zip(built, ohm, strict=True):
        assert one.noise(cord) == pytest.approx(np.hypot(0.003, np.sqrt(2) * 50 / 18250 / ratio))
        assert one.response.linear_slope == reading.response.linear_slope


def random_layout(straight, rng):
    """Return two wavy cords; they need not keep the limits."""
    layout = []
    for name, y in (("a", 6.0), ("b", -6.0)):
        sensor = straight(name, y=y + rng.uniform(-2, 2), z=rng.uniform(-4, 4))
        points = sensor.curve.points.copy()
        points[2:-2, 1] += rng.uniform(-4, 4, len(points) - 4)
        curve = replace(sensor.curve, points=points, tangents=catmull_rom(points))
        layout.append(replace(sensor, curve=curve))
    return layout


def built(problem, layout, rng):
    """Return the test RMSE (mm) of one device, trained on 1,400 noisy frames and tested on 600.

    Cords are shifted by up to 0.3 mm; gauge factors and amplitudes deviate by 5 %.
    """
    amplitude = 1 + rng.normal(0, 0.05, len(problem.fields))
    columns = []
    for sensor in layout:
        path = sample_path(sensor) + rng.uniform(-0.3, 0.3, (1, 3)) * [0, 1, 1]
        at = problem.locator.find(path)
        u = problem.locator.displacement(at, amplitude[:, None, None] * problem.fields)
        columns.append(
            (1 + rng.normal(0, 0.05)) * cord_signals(path, path + u, problem.sense.response)
        )
    S = np.concatenate([np.zeros((1, 2)), np.stack(columns, axis=1)])
    markers = problem.markers * np.concatenate([[1], amplitude])[:, None, None]
    shown = rng.integers(len(S), size=2000)
    read = S[shown] + rng.normal(0, problem.noise, (2000, 2))
    truth = markers[shown].reshape(2000, -1)
    model = Ridge(alpha=1e-9).fit(read[:1400], truth[:1400])
    off = (model.predict(read[1400:]) - truth[1400:]).reshape(600, -1, 3)
    return np.sqrt(((off**2).sum(2) @ problem.marker_weights).mean())


def test_the_band_of_straight_cords_does_not_depend_on_rounding(problem, straight):
    """A straight path lies in many planes, but a cord must wander equally in each run."""
    path = sample_path(straight("a", y=6.0))
    reading = CordReading(problem.sense.response, 14.5, problem.noise, 0.0)
    bands = []
    for last in (0.0, 1e-13, -1e-13):
        moved = path.copy()
        moved[len(path) // 2, 1:] += [last, -2 * last]
        cords = [BuiltCord(moved, 0.0, None)]
        rng, unseen = np.random.default_rng(0), every(problem)
        devices = sample_devices(problem, cords, reading, rng, unseen, draws=20)
        band = ToleranceBand.of(measure_devices(devices, problem.decoder, unseen))
        bands.append((band.low, band.median, band.high))
    assert np.ptp(bands, axis=0).max() < 1e-9


@pytest.mark.slow
def test_the_band_contains_nine_of_ten_devices(problem, straight):
    problem = replace(problem, noise=0.001)
    rng = np.random.default_rng(0)
    ratios, inside = [], []
    for _ in range(20):
        layout = random_layout(straight, rng)
        band = band_of(problem, layout, rng, every(problem), draws=100)
        measured = [built(problem, layout, rng) for _ in range(3)]
        ratios += [m / layout_error(problem, layout) for m in measured]
        inside += [band.low <= m <= band.high for m in measured]
    assert np.median(ratios) == pytest.approx(1, abs=0.1)
    assert np.mean(inside) >= 0.8  # 90 % minus two standard deviations of 60 devices


def test_without_tolerances_the_band_surrounds_the_expected_error(problem, straight):
    layout = random_layout(straight, np.random.default_rng(1))
    band = band_of(problem, layout, np.random.default_rng(2), every(problem), tolerances=EXACT)
    assert band.low < layout_error(problem, layout) < band.high
    assert band.median == pytest.approx(layout_error(problem, layout), rel=0.02)
    wide = band_of(problem, layout, np.random.default_rng(2), every(problem))
    assert wide.high - wide.low > 2 * (band.high - band.low)


def test_errors_of_held_out_states_are_larger(problem, straight):
    """Decoders trained on small amplitudes are tested on full ones, which the band must show."""
    layout = random_layout(straight, np.random.default_rng(1))
    k = np.arange(len(problem.markers))
    size = np.linalg.norm(problem.markers, axis=2).mean(axis=1)
    far = size > np.quantile(size, 0.7)
    held = UnseenStates(HELD_OUT, ((k[~far], k[far]),), ((k[1:], TWISTS),))
    fitted = band_of(problem, layout, np.random.default_rng(2), every(problem), draws=50)
    unseen = band_of(problem, layout, np.random.default_rng(2), held, draws=50)
    assert unseen.median > 1.2 * fitted.median


def test_memory_of_cords_raises_the_errors_of_the_same_devices(problem, straight):
    layout = random_layout(straight, np.random.default_rng(1))
    bands = [
        band_of(problem, layout, np.random.default_rng(2), every(problem), draws=60, memory=memory)
        for memory in (
            None,
            MemoryResidual("none", 0.0, 0.0, 0.0),
            MemoryResidual("small", 0.01, 0.02, 0.04),
            MemoryResidual("large", 0.05, 0.1, 0.2),
        )
    ]
    without, none, small, large = bands
    assert none == without
    assert without.median < small.median < large.median


def test_a_session_that_is_mostly_at_rest_has_a_smaller_error(problem, straight):
    layout = random_layout(straight, np.random.default_rng(1))
    states = every(problem)
    count = len(problem.markers)

    def error(rest):
        shares = np.full(count, (1 - rest) / (count - 1))
        shares[0] = rest
        unseen = replace(states, shares=shares)
        return band_of(problem, layout, np.random.default_rng(2), unseen, draws=30).median

    assert error(0.9) < error(0.5) < error(0.1)


@pytest.mark.parametrize("length", [40.0, 150.0])
def test_lengths_of_cords_are_wrong_by_millimeters(length):
    path = np.linspace([0.0, 0.0, 0.0], [length, 0.0, 0.0], 50)
    cord = BuiltCord(path, 0.0, 0.08)
    reading = CordReading(Response.line(2.0), 14.5, 0.002, 1.0)
    rng = np.random.default_rng(0)
    tolerances = replace(EXACT, ends=0.5)
    built = [sample_built_cord(cord, reading, rng, tolerances)[0] for _ in range(400)]
    loose = np.array([c.length / (1 + c.prestretch) for c in built])
    assert loose.mean() == pytest.approx(length / 1.08, abs=0.1)
    assert loose.std() == pytest.approx(0.5, rel=0.15)
