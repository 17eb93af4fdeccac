"""Durations are stated as people say them."""

import pytest

from defsense_fab.core.progress import describe_duration


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(18, "18 s"), (99, "99 s"), (720, "12 min"), (3590, "1 h"), (8424, "2.3 h"), (63360, "18 h")],
)
def test_durations_are_rounded_to_their_accuracy(seconds, text):
    assert describe_duration(seconds) == text
