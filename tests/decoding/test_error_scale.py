"""The scale of errors."""

import pytest

from defsense_fab.decoding.error_scale import (
    SCALE,
    USABLE_SHARE,
    VERY_GOOD_SHARE,
    describe_error,
    grade_error,
)


@pytest.mark.parametrize(
    ("error", "grade"),
    [(0.0, "very good"), (0.99, "very good"), (1.0, "usable"), (2.49, "usable"), (2.5, "poor")],
)
def test_grades_end_at_shares_of_the_travel(error, grade):
    assert grade_error(error, 50.0) == grade
    assert grade_error(error / 10, 5.0) == grade


def test_a_sentence_has_error_share_travel_grade_and_size():
    text = describe_error(0.49, 52.3, 150.0)
    for words in ("0.49 mm", "0.94 %", "52 mm", "very good", "150 mm"):
        assert words in text
    assert "150" not in describe_error(0.49, 52.3)
    assert "12 % of the 4.2 mm it moves: poor" in describe_error(0.5, 4.2)


def test_without_movement_there_is_no_share():
    assert "%" not in describe_error(0.5, 0.0)


def test_the_scale_states_its_shares():
    for share in (VERY_GOOD_SHARE, USABLE_SHARE):
        assert f"{100 * share:g} %" in SCALE
