"""What cannot be is taken out, what can be is kept."""

import numpy as np
import pytest

from defsense_fab.capture.tracking.track_filters import find_reachable

RATE, T = 30.0, 90
TIME = np.arange(T) / RATE


def moving(m=2, apart=60.0, reach=40.0):
    """Markers that go round with 2 m/s and 30 m/s^2 at most."""
    phase = 2 * np.pi * 0.8 * TIME[:, None] + np.arange(m)
    circle = np.stack([np.cos(phase), np.sin(phase), 0.3 * np.sin(2 * phase)], axis=-1)
    return reach * circle + np.array([apart, 0, 0]) * np.arange(m)[:, None]


def gate(points, sigma=0.05, time=TIME):
    return find_reachable(time, points, np.full(points.shape, sigma))


def test_smooth_motion_with_gaps_is_kept():
    points = moving()
    points[10:14, 0] = np.nan
    points[:3, 1] = np.nan
    points[40:70, 1] = np.nan
    assert (gate(points) == np.isfinite(points[..., 0])).all()


def test_fast_but_possible_motion_is_kept():
    # 66 mm to and fro: 2 m/s and 30 m/s^2 cannot both be larger on a sine than w a, w^2 a.
    a = 2000.0**2 / 30000.0
    x = a * np.sin(30000.0 / 2000.0 * TIME)
    points = np.stack([x, 0 * x, 0 * x], axis=-1)[:, None]
    assert gate(points).all()
    fast = np.cumsum(np.where((TIME > 1) & (TIME < 1.4), 2000.0 / RATE, 0.0))
    assert gate(np.stack([fast, 0 * x, 0 * x], axis=-1)[:, None]).all()


@pytest.mark.parametrize("count", [1, 2, 5])
def test_swapped_numbers_are_removed(count):
    points = moving(apart=250.0)
    swapped = points.copy()
    swapped[30 : 30 + count] = points[30 : 30 + count, ::-1]
    keep = gate(swapped)
    wrong = np.zeros((T, 2), bool)
    wrong[30 : 30 + count] = True
    assert (keep == ~wrong).all()


def test_a_flip_and_a_false_detection_are_removed():
    points = moving()
    points[20, 0] += [0, 0, 45.0]
    points[50, 1] += [400, 0, 0]
    keep = gate(points)
    assert np.argwhere(~keep).tolist() == [[20, 0], [50, 1]]


def test_a_wrong_start_does_not_discard_the_rest():
    points = moving(1)
    points[0] += [0, 300.0, 0]
    assert np.flatnonzero(~gate(points)[:, 0]).tolist() == [0]
    points[1] += [0, 300.0, 0]
    points[-1] += [0, 300.0, 0]
    assert np.flatnonzero(~gate(points)[:, 0]).tolist() == [0, 1, T - 1]


def test_uncertain_positions_may_jump():
    points = moving(1)
    points[20] += [0, 0, 60.0]
    assert gate(points, sigma=30.0).all()
    assert gate(points[:1], time=TIME[:1]).all()
    assert not gate(np.full((T, 1, 3), np.nan)).any()
