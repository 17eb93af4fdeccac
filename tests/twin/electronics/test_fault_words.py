"""Faults of cords and wires, as users write them."""

import pytest

from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.electronics.fault_words import parse_faults
from tests.support.errors import raises


def test_faults_have_channels_and_a_duration():
    cut, swap = parse_faults(("left", "right"), ["cut=left@20-30", "swap=left+right@0"])
    assert (cut.channels, cut.begin, cut.end) == ((0,), 20.0, 30.0)
    assert (swap.begin, swap.end) == (0.0, float("inf"))


def test_fault_of_a_wire_has_a_size_and_lasts_from_the_start():
    (hum,) = parse_faults(("left", "right"), ["hum50=right*20"], ("hum50",))
    assert (hum.channels, hum.begin, hum.amount) == ((1,), 0.0, 20.0)


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
        ("hum50=left@20", "fault-invalid"),
        ("cut=left*big", "fault-invalid"),
        ("cut=left*0", "fault-invalid"),
    ],
)
def test_invalid_faults_are_rejected(word, code):
    with raises(CaptureError, code):
        parse_faults(("left", "right"), [word])
