"""Units of positions in files of other programs."""

import pytest

from defsense_fab.capture.files.length_units import mm_per_unit, resolve_unit
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises


@pytest.mark.parametrize(
    ("texts", "factor"),
    [
        (["mm", "MM", " mm\0", "mm.", "[mm]", "Millimeters", "millimetre", "mill"], 1),
        (["cm", "centimeters", "CENTIMETRES", "cent"], 10),
        (["m", "M", "mete", "metr", "Meters", "metres", "meter", "metre"], 1000),
        (["", "in", "inch", "furlong", "met", "micrometers", "mmm", "min", "?"], None),
    ],
)
def test_spellings(texts, factor):
    assert {mm_per_unit(text) for text in texts} == {factor}


def test_a_stated_unit_fills_in_and_does_not_override():
    assert resolve_unit("", "cm", "a.c3d", "UNITS") == 10
    assert resolve_unit("Zoll", "mm", "a.c3d", "UNITS") == 1
    assert resolve_unit("mete", "m", "a.c3d", "UNITS") == 1000
    with raises(CaptureError, "unit-conflict", unit="m"):
        resolve_unit("m", "mm", "a.c3d", "UNITS")
    with raises(CaptureError, "length-unit-unknown", unit=""):
        resolve_unit(" ", None, "a.c3d", "UNITS")
