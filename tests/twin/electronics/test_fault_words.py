"""Faults of replayed cords, as users write them."""

import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.electronics.fault_words import parse_faults
from tests.support.errors import raises


def test_faults_have_channels_and_a_duration():
    cut, swap = parse_faults(("left", "right"), ["cut=left@20-30", "swap=left+right@0"])
    assert (cut.channels, cut.begin, cut.end) == ((0,), 20.0, 30.0)
    assert (swap.begin, swap.end) == (0.0, float("inf"))


@pytest.mark.parametrize("when", ["30-20", "20-20", "nan-30", "20-nan", "inf"])
def test_fault_that_ends_before_it_starts_is_rejected(when):
    with raises(CaptureError, "fault-ends-early") as caught:
        parse_faults(("left",), [f"cut=left@{when}"])
    assert caught.value.where == f"twin:cut=left@{when}"


@pytest.mark.parametrize(
    ("word", "code"),
    [
        ("left@20-30", "fault-invalid"),
        ("melt=left@20-30", "fault-invalid"),
        ("cut=left@soon", "fault-invalid"),
        ("cut=middle@20", "unknown-channel"),
        ("swap=left@20", "unknown-channel"),
    ],
)
def test_invalid_faults_are_rejected(word, code):
    with raises(CaptureError, code):
        parse_faults(("left", "right"), [word])
