"""What goes wrong with a twin's cords, as it is asked for."""

import pytest
from defsense_fab.twin.recordings.walking_board import parse_faults

from defsense_fab.core.errors import CaptureError


def test_a_fault_begins_and_ends():
    cut, swap = parse_faults(("left", "right"), ["cut=left@20-30", "swap=left+right@0"])
    assert (cut.channels, cut.begin, cut.end) == ((0,), 20.0, 30.0)
    assert (swap.begin, swap.end) == (0.0, float("inf"))


@pytest.mark.parametrize("when", ["30-20", "20-20", "nan-30", "20-nan", "inf"])
def test_one_that_ends_before_it_begins_is_refused(when):
    with pytest.raises(CaptureError, match=f"twin:cut=left@{when}: ends before it begins"):
        parse_faults(("left",), [f"cut=left@{when}"])
