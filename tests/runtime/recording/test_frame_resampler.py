"""Frames at any rate are resampled to a fixed rate."""

import numpy as np
import pytest

from defsense_fab.runtime.recording.animation_recorder import FrameResampler


def resampled(times, fps=30.0):
    """Return steps and positions of a vertex at (1, 2, 3) times the frame's number."""
    resampler = FrameResampler(fps)
    steps = [
        step
        for k, t in enumerate(times)
        for step in resampler.add(t, k * np.array([[1.0, 2.0, 3.0]]))
    ]
    return [k for k, _ in steps], np.array([row[0] for _, row in steps])


@pytest.mark.parametrize("rate", [7.0, 30.0, 100.0, 333.3])
def test_linear_between_frames(rate):
    times = 5.0 + np.arange(40) / rate
    steps, values = resampled(times)
    assert steps == list(range(int(39 / rate * 30 + 1e-6) + 1))
    np.testing.assert_allclose(values[:, 0], np.array(steps) / 30 * rate, atol=2e-4)
    np.testing.assert_allclose(values[:, 2], 3 * values[:, 0])


def test_gap_holds_the_last_shape():
    """Only the two ends of a gap are returned, and the motion continues after it."""
    steps, values = resampled([0.0, 0.1, 0.21, 10.05, 10.15], fps=10.0)
    assert steps == [0, 1, 2, 3, 100, 101]
    np.testing.assert_allclose(values[:, 0], [0, 1, 1 + 0.1 / 0.11, 2, 2, 3.5])


def test_gap_that_ends_on_a_step():
    steps, values = resampled([0.0, 0.1, 5.0], fps=10.0)
    assert steps == [0, 1, 2, 49, 50]
    assert values[:, 0].tolist() == [0, 1, 1, 1, 2]


def test_clock_that_restarts():
    steps, values = resampled([7.0, 7.1, 7.2, 0.0, 0.1, 0.2], fps=10.0)
    assert steps == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(values[:, 0], [0, 1, 2, 4, 5])


def test_two_frames_at_the_same_time():
    steps, _ = resampled([1.0, 1.0, 1.0, 1.1], fps=10.0)
    assert steps == [0, 1]
