"""Impossible positions are removed, possible ones are kept, and tracks are smoothed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.capture.tracking.track_filters import find_reachable, smooth
from defsense_fab.core.errors import CaptureError
from defsense_fab.core.markers import Tracks
from tests.support.errors import raises

RATE, T = 30.0, 90
TIME = np.arange(T) / RATE


def moving(m=2, apart=60.0, reach=40.0):
    """Return positions (t, m, 3), mm, on curves with at most 2 m/s and 30 m/s^2."""
    phase = 2 * np.pi * 0.8 * TIME[:, None] + np.arange(m)
    circle = np.stack([np.cos(phase), np.sin(phase), 0.3 * np.sin(2 * phase)], axis=-1)
    return reach * circle + np.array([apart, 0, 0]) * np.arange(m)[:, None]


def are_reachable(points, sigma=0.05, time=TIME):
    return find_reachable(time, points, np.full(points.shape, sigma))


def test_smooth_motion_with_gaps_is_kept():
    points = moving()
    points[10:14, 0] = np.nan
    points[:3, 1] = np.nan
    points[40:70, 1] = np.nan
    assert (are_reachable(points) == np.isfinite(points[..., 0])).all()


def test_fast_but_possible_motion_is_kept():
    # 66 mm back and forth: 2 m/s and 30 m/s^2 cannot both be larger on a sine than w a, w^2 a.
    a = 2000.0**2 / 30000.0
    x = a * np.sin(30000.0 / 2000.0 * TIME)
    points = np.stack([x, 0 * x, 0 * x], axis=-1)[:, None]
    assert are_reachable(points).all()
    fast = np.cumsum(np.where((TIME > 1) & (TIME < 1.4), 2000.0 / RATE, 0.0))
    assert are_reachable(np.stack([fast, 0 * x, 0 * x], axis=-1)[:, None]).all()


@pytest.mark.parametrize("count", [1, 2, 5])
def test_swapped_numbers_are_removed(count):
    points = moving(apart=250.0)
    swapped = points.copy()
    swapped[30 : 30 + count] = points[30 : 30 + count, ::-1]
    keep = are_reachable(swapped)
    wrong = np.zeros((T, 2), bool)
    wrong[30 : 30 + count] = True
    assert (keep == ~wrong).all()


def test_flip_and_false_detection_are_removed():
    points = moving()
    points[20, 0] += [0, 0, 45.0]
    points[50, 1] += [400, 0, 0]
    keep = are_reachable(points)
    assert np.argwhere(~keep).tolist() == [[20, 0], [50, 1]]


def test_wrong_start_does_not_discard_the_rest():
    points = moving(1)
    points[0] += [0, 300.0, 0]
    assert np.flatnonzero(~are_reachable(points)[:, 0]).tolist() == [0]
    points[1] += [0, 300.0, 0]
    points[-1] += [0, 300.0, 0]
    assert np.flatnonzero(~are_reachable(points)[:, 0]).tolist() == [0, 1, T - 1]


def test_uncertain_positions_may_jump():
    points = moving(1)
    points[20] += [0, 0, 60.0]
    assert are_reachable(points, sigma=30.0).all()
    assert are_reachable(points[:1], time=TIME[:1]).all()
    assert not are_reachable(np.full((T, 1, 3), np.nan)).any()


def tracks_of(time, points, sigma=None):
    sigma = np.full(points.shape, np.nan) if sigma is None else sigma
    m = points.shape[1]
    return Tracks(time, np.arange(m), points, np.where(np.isfinite(points), sigma, np.nan),
                  np.arange(len(time)))  # fmt: skip


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.floats(0.15, 1.0), st.booleans())
def test_smoothing_keeps_parabolas_and_gaps(seed, window, known):
    rng = np.random.default_rng(seed)
    time = 1000 + np.cumsum(rng.uniform(0.005, 0.06, 80))
    t = time - 1001
    c = rng.normal(0, 50, (3, 4, 3))
    points = c[0] + c[1] * t[:, None, None] + c[2] * t[:, None, None] ** 2
    points[rng.random((80, 4)) < 0.3] = np.nan
    points[20:60, 2] = np.nan
    tracks = tracks_of(time, points, rng.uniform(0.01, 1, points.shape) if known else None)
    out = smooth(tracks, window)
    assert (out.visible == tracks.visible).all()
    np.testing.assert_allclose(out.points, points, atol=1e-6)
    assert (np.isfinite(out.sigma) == (np.isfinite(points) & known)).all()
    if known:
        ratio = out.sigma[tracks.visible] / tracks.sigma[tracks.visible]
        assert ratio.max() <= 1 + 1e-12
        assert ratio.min() < 0.9


def test_smoothing_reduces_noise_and_bends_curves_as_predicted():
    rng = np.random.default_rng(1)
    n, dt, window, noise, omega = 3000, 0.01, 0.3, 0.2, 6.0
    time = dt * np.arange(n)
    curve = 10 * np.sin(omega * time[:, None, None] + np.array([0, 1.0, 2.0]))
    out = smooth(
        tracks_of(time, curve + rng.normal(0, noise, (n, 1, 3)), np.full((n, 1, 3), noise)), window
    )
    inner = slice(20, -20)
    # The parabola's value at its middle is a sum with weights of kernel (1 - u^2) (a + b u^2):
    u = np.arange(-15, 16) / 15
    moments = [((1 - u * u) * u**k).sum() for k in (0, 2, 4)]
    line = (1 - u * u) * (moments[2] - moments[1] * u * u)
    line /= line.sum()
    np.testing.assert_allclose(out.sigma[inner], noise * np.sqrt((line**2).sum()), rtol=1e-9)
    quiet = smooth(tracks_of(time, curve), window).points - curve
    gain = (line * np.cos(omega * 0.15 * u)).sum() - 1  # of this sine
    np.testing.assert_allclose(quiet[inner], gain * curve[inner], atol=1e-9)
    assert abs(gain) < (omega * 0.15) ** 4 / 24 * abs((line * u**4).sum()) * 1.01
    score = (out.points - curve - quiet) / out.sigma
    assert score.std() == pytest.approx(1, abs=0.1)
    assert (out.points - curve)[inner].std() < 0.45 * noise
    assert out.sigma[0, 0, 0] > out.sigma[100, 0, 0]  # the ends have neighbors on one side only


def test_smoothing_gives_more_weight_to_precise_points():
    time = np.arange(21) / 10
    points = np.zeros((21, 1, 3))
    points[10] = 5.0
    sigma = np.ones(points.shape)
    sigma[10, 0, 0], sigma[10, 0, 1] = 100.0, 0.01
    out = smooth(tracks_of(time, points, sigma), 1.0)
    assert abs(out.points[10, 0, 0]) < 1e-2
    assert out.points[10, 0, 1] == pytest.approx(5, abs=1e-2)
    assert out.sigma[10, 0, 0] < 1
    assert 0.0099 < out.sigma[10, 0, 1] <= 0.01


def test_few_points_are_not_smoothed():
    time = np.arange(40) / 10
    points = np.full((40, 2, 3), np.nan)
    points[:, 0] = np.random.default_rng(2).normal(size=(40, 3))
    points[[5, 6, 7, 30], 1] = [[1.0], [5.0], [2.0], [8.0]]
    tracks = tracks_of(time, points, np.full(points.shape, 0.5))
    out = smooth(tracks, 0.8)
    np.testing.assert_array_equal(out.points[:, 1], points[:, 1])
    np.testing.assert_array_equal(out.sigma[:, 1], tracks.sigma[:, 1])
    assert (out.points[:, 0] != points[:, 0]).all()


def test_input_that_cannot_be_smoothed_is_rejected():
    time, points = np.arange(10) / 10, np.zeros((10, 1, 3))
    with raises(CaptureError, "window-too-short"):
        smooth(tracks_of(time, points), 0.1)
    for window in (0.0, -1.0, np.nan, np.inf):
        with raises(CaptureError, "window-invalid"):
            smooth(tracks_of(time, points), window)
    with raises(CaptureError, "not-positive"):
        smooth(tracks_of(time, points, points), 1.0)
    nothing = tracks_of(time, points * np.nan)
    assert not smooth(nothing, 1.0).visible.any()
