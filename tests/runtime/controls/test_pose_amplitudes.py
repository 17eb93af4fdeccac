"""Amplitudes of poses against known ones, brute force, opposites and unknown motions."""

import numpy as np
import pytest

from defsense_fab.core.errors import ControlError
from defsense_fab.runtime.controls.pose_amplitudes import (
    RADIUS_90,
    PoseAmplitudes,
    PoseBasis,
    PoseRamp,
)
from tests.runtime.bars import POSES, STEPS, bent, markers, poses, pulled, twisted
from tests.support.errors import raises

SD = 0.5


@pytest.fixture(scope="module")
def rest():
    return markers(40, np.random.default_rng(0))


@pytest.fixture(scope="module")
def basis(rest):
    return poses(rest)


@pytest.fixture
def amplitudes(basis):
    return PoseAmplitudes(basis)


def test_ramps_between_and_beyond_their_states(rest, basis):
    """Poses are exact at the states, near the circle between them, and linear beyond them."""
    for a in STEPS:
        got = basis.displacements([a, 0, 0, 0, 0, 0])
        assert np.allclose(got, bent(rest, a), atol=1e-9)
    between = basis.displacements([0.6, 0, 0, 0, 0, 0])
    assert np.abs(between - bent(rest, 0.6)).max() < 0.2
    one, two, three = (basis.displacements([0, 0, a, 0, 0, 0]) for a in (1.0, 1.1, 1.2))
    assert np.allclose(two - one, three - two)
    assert not basis.displacements(np.zeros(6)).any()


def test_ramps_are_smooth(basis):
    """Finite differences show no step in value or slope, at the states in particular."""
    h = 1e-6
    for a in (*STEPS, 0.4, 1.2):
        for p in range(6):
            row = np.zeros((3, 6))
            row[:, p] = a - h, a, a + h
            low, middle, high = map(basis.displacements, row)
            assert np.abs((high - middle) - (middle - low)).max() < 1e-8


def test_one_state_is_a_line(rest):
    ramp = PoseRamp(np.array([1.0]), pulled(rest, 1)[None])
    line = PoseBasis(("pull",), (ramp,))
    assert np.allclose(line.displacements([0.3]), pulled(rest, 0.3))


@pytest.mark.parametrize(
    "true",
    [
        [0.5, 0, 0, 0, 0, 0],
        [0, 0.8, 0, 0, 0, 0.1],
        [0, 0, 0, 1.0, 0, 0],
        [0, 0.3, 0.4, 0, 0.2, 0.1],
        [1.2, 0, 0, 0, 0, 0],
    ],
)
def test_known_amplitudes_are_recovered(basis, amplitudes, true):
    """They are exact without noise, and within their standard deviations with noise."""
    exact = amplitudes(basis.displacements(true), np.full(40, SD))
    assert exact.values == pytest.approx(true, abs=2e-3)
    assert exact.explained == pytest.approx(1)
    rng = np.random.default_rng(1)
    off = []
    for _ in range(60):
        u = basis.displacements(true) + rng.normal(0, SD, (40, 3))
        found = amplitudes(u, np.full(40, SD))
        active = np.array(true) > 0
        off.append(((found.values - true) / found.sd)[active])
        assert (found.confidence[active] > 0.9).all()
    assert 0.6 < np.std(off) < 1.5
    assert np.abs(np.mean(off, axis=0)).max() < 0.6


def test_true_shapes_between_the_states(rest, amplitudes):
    """Fit the true shapes of the bar, not those of the interpolated poses."""
    for a in (0.1, 0.35, 0.6, 0.9):
        up = amplitudes(bent(rest, a), np.full(40, SD))
        assert up.values == pytest.approx([a, 0, 0, 0, 0, 0], abs=0.02)
        left = amplitudes(twisted(rest, a, -1), np.full(40, SD))
        assert left.values == pytest.approx([0, 0, 0, a, 0, 0], abs=0.02)


def test_against_brute_force(rest):
    """The best amplitudes of a fine grid are no better than the fit."""
    basis = PoseBasis(
        ("up", "pull"),
        tuple(
            PoseRamp(STEPS, np.array([shape(rest, a) for a in STEPS])) for shape in (bent, pulled)
        ),
    )
    rng = np.random.default_rng(2)
    u = basis.displacements([0.62, 0.37]) + rng.normal(0, 2, (40, 3))
    sd = rng.uniform(0.5, 3, 40)

    def cost(a):
        return (((u - basis.displacements(a)) / sd[:, None]) ** 2).sum() + np.square(a).sum()

    grid = np.arange(0, 1.2, 0.01)
    best = min((cost(np.array([a, b])), a, b) for a in grid for b in grid)
    found = PoseAmplitudes(basis)(u, sd)
    assert cost(found.values) <= best[0]
    assert found.values == pytest.approx(best[1:], abs=0.011)


def test_opposites_are_never_both_active(basis, amplitudes):
    """This holds for any markers, from any former amplitudes."""
    pairs = [{POSES[p], POSES[q]} for p, q in zip(*np.nonzero(basis.opposites), strict=True)]
    assert {frozenset(p) for p in pairs} == {
        frozenset(POSES[:2]),
        frozenset(POSES[2:4]),
    }
    rng = np.random.default_rng(3)
    for _ in range(200):
        u = basis.displacements(rng.uniform(0, 0.5, 6)) + rng.normal(0, 10, (40, 3))
        a = amplitudes(u, np.full(40, SD)).values
        assert (a >= 0).all()
        assert not a[0] * a[1]
        assert not a[2] * a[3]


def test_former_amplitudes_do_not_matter(basis, amplitudes):
    """A fit from the opposite pose finds the same amplitudes."""
    for true in ([1.0, 0, 0, 0, 0, 0], [0, 1.0, 0, 0, 0, 0], [0, 0, 1.0, 0, 0, 0]):
        found = amplitudes(basis.displacements(true), np.full(40, SD))
        assert found.values == pytest.approx(true, abs=2e-3)


def test_motion_outside_all_poses_has_low_confidence(basis, amplitudes):
    """Rest with noise has high confidence."""
    rng = np.random.default_rng(4)
    still = amplitudes(rng.normal(0, SD, (40, 3)), np.full(40, SD))
    assert still.values.max() < 0.05
    assert still.confidence.min() > 0.9
    strange = amplitudes(rng.normal(0, 20, (40, 3)), np.full(40, SD))
    assert strange.explained < 0.2
    assert strange.confidence.max() < 0.2


def test_markers_without_a_position_are_left_out(basis, amplitudes):
    true = [0, 0.6, 0, 0, 0, 0]
    u = basis.displacements(true)
    u[::2] = np.nan
    sd = np.full(40, SD)
    sd[1] = np.nan
    assert amplitudes(u, sd).values == pytest.approx(true, abs=2e-3)
    nothing = amplitudes(np.full((40, 3), np.nan), sd)
    assert nothing.values == pytest.approx(true, abs=2e-3)  # the last ones are kept
    assert not nothing.confidence.any()
    assert np.isinf(nothing.sd).all()


def test_correlated_errors_raise_the_deviation(basis):
    """Forty markers decoded from three cords are as certain as three numbers."""
    rng = np.random.default_rng(5)
    true = np.array([0.5, 0, 0, 0, 0, 0])
    pull = basis.displacements([0, 0, 0, 0, 0, 1.0])  # one cord's error moves all markers
    size = np.sqrt((pull**2).mean())
    together, alone = PoseAmplitudes(basis, independent=3), PoseAmplitudes(basis)
    sd = np.full(40, SD)
    found = []
    for error in rng.normal(0, SD / size, 40):
        u = basis.displacements(true) + error * pull
        found.append(together(u, sd).values[5])
    deviation = together(basis.displacements(true), sd).sd
    assert deviation[0] > 4 * alone(basis.displacements(true), sd).sd[0]
    assert np.std(found) < 3 * deviation[5]


def test_radius_of_a_normal_error():
    x = np.random.default_rng(6).normal(size=(200_000, 3))
    inside = np.linalg.norm(x, axis=1) < RADIUS_90
    assert inside.mean() == pytest.approx(0.9, abs=0.003)


@pytest.mark.parametrize(
    ("amplitudes", "shape", "code"),
    [
        ([1.0], (2, 4, 3), "wrong-shape"),
        ([0.5, 0.5], (2, 4, 3), "not-increasing"),
        ([0.0, 1.0], (2, 4, 3), "rest-displaced"),
        ([-1.0, 1.0], (2, 4, 3), "not-increasing"),
        ([np.nan], (1, 4, 3), "not-finite"),
    ],
)
def test_invalid_ramps_are_refused(amplitudes, shape, code):
    with raises(ControlError, code):
        PoseRamp(np.array(amplitudes), np.ones(shape))


def test_invalid_bases_are_refused(rest, amplitudes):
    ramp, other = (PoseRamp(np.ones(1), np.ones((1, m, 3))) for m in (4, 5))
    with raises(ControlError, "markers-differ"):
        PoseBasis(("a", "b"), (ramp, other))
    with raises(ControlError, "name-repeated"):
        PoseBasis(("a", "a"), (ramp, ramp))
    with raises(ControlError, "count-differs"):
        PoseBasis(("a", "b"), (ramp,))
    with raises(ControlError, "wrong-shape", markers=40):
        amplitudes(np.zeros((3, 3)), np.ones(3))
