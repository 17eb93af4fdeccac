"""Curves with few points through what a hand draws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from defsense_fab.core.curves.curve import Hermite, catmull_rom
from defsense_fab.core.curves.curve_fit import fit_curve


def furthest(stroke, curve):
    line = curve.sample(400)
    return np.linalg.norm(stroke[:, None] - line, axis=2).min(1).max()


def test_a_straight_stroke_takes_two_points():
    curve = fit_curve(np.array([[0.0, 1.0], [3.0, 1.0], [50.0, 1.0]]), 0.1)
    np.testing.assert_allclose(curve.points, [[0, 1], [50, 1]])


def test_a_wave_takes_as_few_points_as_keep_the_tolerance():
    x = np.linspace(0, 120, 241)
    stroke = np.stack([x, 8 * np.sin(x / 18)], axis=1)
    fine, rough = fit_curve(stroke, 0.3), fit_curve(stroke, 3.0)
    assert furthest(stroke, fine) <= 0.31
    assert len(rough.points) < len(fine.points) <= 12
    np.testing.assert_array_equal(fine.tangents, catmull_rom(fine.points))
    np.testing.assert_array_equal(fine.points[[0, -1]], stroke[[0, -1]])


def test_a_trembling_hand_is_smoothed():
    rng = np.random.default_rng(0)
    x = np.linspace(0, 100, 201)
    true = np.stack([x, 0.002 * x**2], axis=1)
    curve = fit_curve(true + rng.uniform(-0.3, 0.3, true.shape), 0.8)
    assert len(curve.points) <= 5
    assert furthest(true, curve) < 0.6


@given(st.integers(2, 5), st.integers(0, 10**6))
def test_a_curve_of_even_points_is_found_again(count, seed):
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.uniform(-0.4, 0.4, count - 1))
    steps = 20 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    points = np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    drawn = Hermite(points, catmull_rom(points))
    found = fit_curve(drawn.sample(60), 0.5)
    assert len(found.points) <= count + 2
    assert furthest(drawn.sample(60), found) <= 0.52


@pytest.mark.parametrize("stroke", [[[1.0, 2.0]], [[1.0, 2.0], [1.0, 2.0]]])
def test_a_stroke_without_length_is_refused(stroke):
    with pytest.raises(ValueError, match="needs a length"):
        fit_curve(np.array(stroke), 0.5)
