"""Formulas: their values, and everything that is none."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from defsense_fab.core.errors import ControlError
from defsense_fab.runtime.controls.expressions import compile_expression

VALUES = {"up": 0.6, "down": 0.1, "twist": -0.5}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("up", 0.6),
        ("up - down", 0.5),
        ("clip(2 * twist, 0, 1)", 0.0),
        ("clip(2*up, 0, 1)", 1.0),
        ("-twist ** 2", -0.25),
        ("abs(twist) + max(up, down, 0.3)", 1.1),
        ("min(up, down)", 0.1),
        ("up > 0.5", 1.0),
        ("0.2 < up < 0.5", 0.0),
        ("(up > 0.5) * twist", -0.5),
        ("up / 2e0", 0.3),
        ("  (up\n - down)", 0.5),
        ("up / (down - 0.1)", 0.0),  # no finite number
        ("twist ** 0.5", 0.0),
        ("1e300 * 1e300", 0.0),
        ("9 ** 9 ** 9", 0.0),
    ],
)
def test_values(text, value):
    assert compile_expression(text, VALUES)(VALUES) == pytest.approx(value)


def test_names_that_are_used():
    assert compile_expression("up - down * 2", VALUES).names == {"up", "down"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("upp - down", r"column 1: there is no 'upp'; did you mean 'up'\? names are: down"),
        ("up - dwn", "column 6: there is no 'dwn'"),
        ("  up - dwn", "column 8: there is no 'dwn'"),
        ("up -", "column .: is no formula"),
        ("", "is no formula"),
        ("up; down", "column 3: is no formula"),
        ("a) + (b", "is no formula"),
        ("up and down", "column 1: cannot be used here"),
        ("up % 2", "cannot be used here"),
        ("up.real", "column 1: cannot be used here"),
        ("up[0]", "cannot be used here"),
        ("lambda: 1", "cannot be used here"),
        ("[x for x in (1, 2)]", "cannot be used here"),
        ("(1, 2)", "cannot be used here"),
        ("f'{up}'", "cannot be used here"),
        ("(x := 3)", "cannot be used here"),
        ("'up'", "'up' is no number"),
        ("True", "True is no number"),
        ("2j", "2j is no number"),
        ("1e999", "too large"),
        ("9" * 400, "too large"),
        ("sin(up)", "there is no function 'sin'; there is: min, max, abs, clip"),
        ("__import__('os')", "there is no function '__import__'"),
        ("abs(up, down)", "abs takes 1 values"),
        ("clip(up)", "clip takes 3 values"),
        ("clip(x=up, low=0, high=1)", "clip takes 3 values"),
        ("max(*up)", "max takes 2 or more"),
        ("max(1, *up)", "cannot be used here"),
        ("(" * 300 + "up" + ")" * 300, "formula"),
        ("+".join(["up"] * 100), "more than 40 operations"),
        ("up + " * 200, "500 is the limit"),
        ("up\0", "is no formula"),
        ("1if up", "is no formula"),
    ],
)
def test_what_is_no_formula(text, message):
    with pytest.raises(ControlError, match=message) as error:
        compile_expression(text, VALUES)
    assert "\n" not in str(error.value)


@given(st.text(alphabet="updown twist0123456789.+-*/()<>=,clipabsmax", max_size=60))
def test_any_text_is_a_number_or_an_error(text):
    try:
        formula = compile_expression(text, VALUES)
    except ControlError:
        return
    assert math.isfinite(formula(VALUES))
