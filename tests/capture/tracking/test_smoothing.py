"""Smoothing in time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.capture.tracking.track_filters import smooth
from defsense_fab.core.errors import CaptureError
from defsense_fab.core.markers import Tracks
from tests.support.errors import raises


def made(time, points, sigma=None):
    sigma = np.full(points.shape, np.nan) if sigma is None else sigma
    m = points.shape[1]
    return Tracks(time, np.arange(m), points, np.where(np.isfinite(points), sigma, np.nan),
                  np.arange(len(time)))  # fmt: skip


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.floats(0.15, 1.0), st.booleans())
def test_parabolas_and_gaps_are_unchanged(seed, window, known):
    rng = np.random.default_rng(seed)
    time = 1000 + np.cumsum(rng.uniform(0.005, 0.06, 80))
    t = time - 1001
    c = rng.normal(0, 50, (3, 4, 3))
    points = c[0] + c[1] * t[:, None, None] + c[2] * t[:, None, None] ** 2
    points[rng.random((80, 4)) < 0.3] = np.nan
    points[20:60, 2] = np.nan
    tracks = made(time, points, rng.uniform(0.01, 1, points.shape) if known else None)
    out = smooth(tracks, window)
    assert (out.visible == tracks.visible).all()
    np.testing.assert_allclose(out.points, points, atol=1e-6)
    assert (np.isfinite(out.sigma) == (np.isfinite(points) & known)).all()
    if known:
        ratio = out.sigma[tracks.visible] / tracks.sigma[tracks.visible]
        assert ratio.max() <= 1 + 1e-12
        assert ratio.min() < 0.9


def test_noise_and_bias_fall_as_predicted():
    rng = np.random.default_rng(1)
    n, dt, window, noise, omega = 3000, 0.01, 0.3, 0.2, 6.0
    time = dt * np.arange(n)
    curve = 10 * np.sin(omega * time[:, None, None] + np.array([0, 1.0, 2.0]))
    out = smooth(
        made(time, curve + rng.normal(0, noise, (n, 1, 3)), np.full((n, 1, 3), noise)), window
    )
    inner = slice(20, -20)
    # The parabola's value at its middle is a sum with weights of kernel (1 - u^2) (a + b u^2):
    u = np.arange(-15, 16) / 15
    moments = [((1 - u * u) * u**k).sum() for k in (0, 2, 4)]
    line = (1 - u * u) * (moments[2] - moments[1] * u * u)
    line /= line.sum()
    np.testing.assert_allclose(out.sigma[inner], noise * np.sqrt((line**2).sum()), rtol=1e-9)
    quiet = smooth(made(time, curve), window).points - curve
    gain = (line * np.cos(omega * 0.15 * u)).sum() - 1  # what it does to this sine
    np.testing.assert_allclose(quiet[inner], gain * curve[inner], atol=1e-9)
    assert abs(gain) < (omega * 0.15) ** 4 / 24 * abs((line * u**4).sum()) * 1.01
    score = (out.points - curve - quiet) / out.sigma
    assert score.std() == pytest.approx(1, abs=0.1)
    assert (out.points - curve)[inner].std() < 0.45 * noise
    assert out.sigma[0, 0, 0] > out.sigma[100, 0, 0]  # the ends are held from one side only


def test_precise_points_count_for_more():
    time = np.arange(21) / 10
    points = np.zeros((21, 1, 3))
    points[10] = 5.0
    sigma = np.ones(points.shape)
    sigma[10, 0, 0], sigma[10, 0, 1] = 100.0, 0.01
    out = smooth(made(time, points, sigma), 1.0)
    assert abs(out.points[10, 0, 0]) < 1e-2
    assert out.points[10, 0, 1] == pytest.approx(5, abs=1e-2)
    assert out.sigma[10, 0, 0] < 1
    assert 0.0099 < out.sigma[10, 0, 1] <= 0.01


def test_few_points_are_unchanged():
    time = np.arange(40) / 10
    points = np.full((40, 2, 3), np.nan)
    points[:, 0] = np.random.default_rng(2).normal(size=(40, 3))
    points[[5, 6, 7, 30], 1] = [[1.0], [5.0], [2.0], [8.0]]
    tracks = made(time, points, np.full(points.shape, 0.5))
    out = smooth(tracks, 0.8)
    np.testing.assert_array_equal(out.points[:, 1], points[:, 1])
    np.testing.assert_array_equal(out.sigma[:, 1], tracks.sigma[:, 1])
    assert (out.points[:, 0] != points[:, 0]).all()


def test_invalid_input_is_refused():
    time, points = np.arange(10) / 10, np.zeros((10, 1, 3))
    with raises(CaptureError, "window-too-short"):
        smooth(made(time, points), 0.1)
    for window in (0.0, -1.0, np.nan, np.inf):
        with raises(CaptureError, "window-invalid"):
            smooth(made(time, points), window)
    with raises(CaptureError, "sigma-not-positive"):
        smooth(made(time, points, points), 1.0)
    nothing = made(time, points * np.nan)
    assert not smooth(nothing, 1.0).visible.any()
