"""Values between samples."""

import numpy as np

from defsense_fab.core.curves.sampling import at_times


def test_times_that_files_round_are_the_samples_own() -> None:
    time = np.arange(5) / 30
    values = np.array([[1.0], [5.0], [np.nan], [7.0], [2.0]])
    found = at_times(np.round(time, 6), time, values)
    np.testing.assert_array_equal(found, values)
    between = at_times(np.array([1 / 60, 0.05, -1e-3, 4 / 30 + 1e-3]), time, values)
    np.testing.assert_allclose(between[:, 0], [3.0, np.nan, np.nan, np.nan])


def test_nothing_is_told_in_gaps() -> None:
    found = at_times(np.array([0.5, 0.02]), np.array([0.0, 0.04, 1.0]), np.ones((3, 1)))
    np.testing.assert_array_equal(found[:, 0], [np.nan, 1.0])
