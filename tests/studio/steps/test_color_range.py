"""Round ends of color bars."""

import numpy as np
import pytest

from defsense_fab.studio.steps.inside.color_range import range_of, round_range


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 9.4, (0.0, 10.0)),
        (-3.1, 9.4, (-4.0, 10.0)),
        (-0.01, 9.4, (0.0, 10.0)),
        (2.0, 9.4, (0.0, 10.0)),
        (-9.4, -1.0, (-10.0, 0.0)),
        (-0.052, 0.048, (-0.06, 0.06)),
    ],
)
def test_ranges_have_round_ends_and_contain_zero(low, high, expected):
    found = round_range(low, high)
    assert (found.low, found.high) == pytest.approx(expected)
    ticks = (found.high - found.low) / found.step
    assert ticks == pytest.approx(round(ticks))
    assert 2 <= ticks <= 8


def test_a_range_without_zero_uses_the_whole_bar():
    found = round_range(2.31, 2.46, has_zero=False)
    assert 2.25 <= found.low <= 2.31
    assert 2.46 <= found.high <= 2.5


def test_outliers_and_unknown_numbers_do_not_widen_a_range():
    numbers = np.append(np.linspace(0, 8, 2000), [np.nan, 500.0])
    assert range_of(numbers).high == 8.0
    empty = range_of(np.full(3, np.nan))
    assert empty.high > empty.low
