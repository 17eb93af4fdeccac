"""Test curves that are fitted to strokes, and arcs that approximate curves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from defsense_fab.core.curve import Hermite, catmull_rom
from defsense_fab.core.curve_conversion import curve_to_arcs, fit_curve


def largest_distance(stroke, curve):
    line = curve.sample(400)
    return np.linalg.norm(stroke[:, None] - line, axis=2).min(1).max()


def test_straight_stroke_gets_as_few_points_as_a_device_accepts():
    curve = fit_curve(np.array([[0.0, 1.0], [3.0, 1.0], [50.0, 1.0]]), 0.1)
    np.testing.assert_allclose(curve.points, [[0, 1], [50 / 3, 1], [100 / 3, 1], [50, 1]])


def test_wave_gets_the_fewest_points_within_the_tolerance():
    x = np.linspace(0, 120, 241)
    stroke = np.stack([x, 8 * np.sin(x / 18)], axis=1)
    fine, rough = fit_curve(stroke, 0.3), fit_curve(stroke, 3.0)
    assert largest_distance(stroke, fine) <= 0.31
    assert len(rough.points) < len(fine.points) <= 12
    np.testing.assert_array_equal(fine.tangents, catmull_rom(fine.points))
    np.testing.assert_array_equal(fine.points[[0, -1]], stroke[[0, -1]])


def test_trembling_stroke_is_smoothed():
    rng = np.random.default_rng(0)
    x = np.linspace(0, 100, 201)
    true = np.stack([x, 0.002 * x**2], axis=1)
    curve = fit_curve(true + rng.uniform(-0.3, 0.3, true.shape), 0.8)
    assert len(curve.points) <= 5
    assert largest_distance(true, curve) < 0.6


@given(st.integers(2, 5), st.integers(0, 10**6))
def test_curve_with_even_points_is_recovered(count, seed):
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.uniform(-0.4, 0.4, count - 1))
    steps = 20 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    points = np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    drawn = Hermite(points, catmull_rom(points))
    fitted = fit_curve(drawn.sample(60), 0.5)
    assert len(fitted.points) <= count + 2
    assert largest_distance(drawn.sample(60), fitted) <= 0.52


@pytest.mark.parametrize("stroke", [[[1.0, 2.0]], [[1.0, 2.0], [1.0, 2.0]]])
def test_stroke_without_length_is_refused(stroke):
    with pytest.raises(ValueError, match="needs a length"):
        fit_curve(np.array(stroke), 0.5)


def circle(arc):
    """Return center and radius of the circle through three points (perpendicular bisectors)."""
    a, m, b = arc
    lines = 2 * np.array([m - a, b - a])
    center = np.linalg.solve(lines, np.array([m @ m - a @ a, b @ b - a @ a]))
    return center, np.linalg.norm(a - center)


@pytest.mark.parametrize("seed", range(5))
def test_arcs_join_smoothly_and_follow_the_curve(seed):
    rng = np.random.default_rng(seed)
    x = np.array([2, 10, 36, 62, 88, 114, 140, 148.0])
    points = np.stack([x, rng.uniform(-10, 10, 8)], axis=1)
    curve = Hermite(points, catmull_rom(points))
    chain = curve_to_arcs(curve, 0.01)
    assert chain[1:, 0] == pytest.approx(chain[:-1, 2], abs=1e-9)
    assert chain[0, 0] == pytest.approx(points[0])
    assert chain[-1, 2] == pytest.approx(points[-1])
    circles = [circle(a) for a in chain]
    for (c, _), (d, _), at in zip(circles[:-1], circles[1:], chain[:-1, 2], strict=True):
        u, v = at - c, at - d
        cross = u[0] * v[1] - u[1] * v[0]
        assert abs(cross) < 1e-5 * np.linalg.norm(u) * np.linalg.norm(v)
    for p in curve.sample(50):
        closest = np.argsort(np.linalg.norm(chain[:, 1] - p, axis=1))[:6]
        distances = [abs(np.linalg.norm(p - circles[i][0]) - circles[i][1]) for i in closest]
        assert min(distances) < 0.012


def test_straight_curve_has_straight_arcs():
    points = np.array([[0, 0], [10, 0], [30, 0.0]])
    chain = curve_to_arcs(Hermite(points, catmull_rom(points)), 0.01)
    assert np.abs(chain[:, :, 1]).max() < 1e-12
