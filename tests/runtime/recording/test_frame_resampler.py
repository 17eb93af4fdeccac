"""Frames of any rate at the pictures' times."""

import numpy as np
import pytest

from defsense_fab.runtime.recording.animation_recorder import FrameResampler


def pictures(times, fps=30.0):
    """Numbers and values of pictures of a vertex that is at the frame's number times (1, 2, 3)."""
    resampler = FrameResampler(fps)
    found = [
        picture
        for k, t in enumerate(times)
        for picture in resampler.add(t, k * np.array([[1.0, 2.0, 3.0]]))
    ]
    return [step for step, _ in found], np.array([row[0] for _, row in found])


@pytest.mark.parametrize("rate", [7.0, 30.0, 100.0, 333.3])
def test_linear_between_frames(rate):
    times = 5.0 + np.arange(40) / rate
    steps, values = pictures(times)
    assert steps == list(range(int(39 / rate * 30 + 1e-6) + 1))
    np.testing.assert_allclose(values[:, 0], np.array(steps) / 30 * rate, atol=2e-4)
    np.testing.assert_allclose(values[:, 2], 3 * values[:, 0])


def test_a_gap_holds_the_last_shape():
    """Nothing is written over a gap but its two ends, and the motion goes on after it."""
    steps, values = pictures([0.0, 0.1, 0.21, 10.05, 10.15], fps=10.0)
    assert steps == [0, 1, 2, 3, 100, 101]
    np.testing.assert_allclose(values[:, 0], [0, 1, 1 + 0.1 / 0.11, 2, 2, 3.5])


def test_a_gap_that_ends_on_a_picture():
    steps, values = pictures([0.0, 0.1, 5.0], fps=10.0)
    assert steps == [0, 1, 2, 49, 50]
    assert values[:, 0].tolist() == [0, 1, 1, 1, 2]


def test_a_clock_that_begins_anew():
    steps, values = pictures([7.0, 7.1, 7.2, 0.0, 0.1, 0.2], fps=10.0)
    assert steps == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(values[:, 0], [0, 1, 2, 4, 5])


def test_two_frames_of_one_time():
    steps, _ = pictures([1.0, 1.0, 1.0, 1.1], fps=10.0)
    assert steps == [0, 1]
