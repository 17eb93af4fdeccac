"""Positions that other programs write for markers that were not visible."""

import numpy as np

from defsense_fab.capture.files.absent_markers import hide_absent


def test_zeros_and_partial_nan_become_nan_and_zeros_are_counted():
    points = np.ones((4, 2, 3))
    points[1, 0], points[2, 1], points[3, 1] = 0, 0, [1, np.nan, 2]
    points[0, 1] = [0, 0, 5]  # a position with two zero coordinates
    result, notes = hide_absent(points, ["tag_7", "wand"])
    absent = np.isnan(result).all(2)
    assert absent.tolist() == [[False, False], [True, False], [False, True], [False, True]]
    assert np.isfinite(result[~absent]).all()
    assert len(notes) == 1
    assert "tag_7 (1), wand (1)" in notes[0]
    assert np.isfinite(points[1]).all(), "the argument is unchanged"


def test_negative_zero_counts_and_visible_markers_have_no_note():
    points = np.array([[[-0.0, 0.0, -0.0]], [[1e-300, 0, 0]]])
    result, _ = hide_absent(points, ["a"])
    assert np.isnan(result[0]).all()
    assert np.isfinite(result[1]).all()
    ones = np.ones((2, 1, 3))
    result, notes = hide_absent(ones, ["a"])
    assert result is ones
    assert notes == []


def test_positions_with_known_standard_deviations_are_measured():
    points, sigma = np.zeros((2, 1, 3)), np.full((2, 1, 3), 0.1)
    sigma[1] = np.nan
    result, notes = hide_absent(points, ["a"], sigma)
    assert np.isfinite(result[0]).all()
    assert np.isnan(result[1]).all()
    assert "a (1)" in notes[0]
