"""The values of formulas, and the refusal of invalid ones."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from defsense_fab.core.errors import ControlError
from defsense_fab.runtime.controls.expressions import compile_expression
from tests.support.errors import raises

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
        ("up / (down - 0.1)", 0.0),  # not finite
        ("twist ** 0.5", 0.0),
        ("1e300 * 1e300", 0.0),
        ("9 ** 9 ** 9", 0.0),
    ],
)
def test_values(text, value):
    assert compile_expression(text, VALUES)(VALUES) == pytest.approx(value)


def test_used_names():
    assert compile_expression("up - down * 2", VALUES).names == {"up", "down"}


@pytest.mark.parametrize(
    ("text", "code", "data"),
    [
        ("upp - down", "unknown-name", {"column": 1, "name": "upp", "suggestion": "up"}),
        ("up - dwn", "unknown-name", {"column": 6, "name": "dwn"}),
        ("  up - dwn", "unknown-name", {"column": 8, "name": "dwn"}),
        ("up -", "formula-invalid", {}),
        ("", "formula-invalid", {}),
        ("up; down", "formula-invalid", {"column": 3}),
        ("a) + (b", "formula-invalid", {}),
        ("up and down", "formula-unsupported", {"column": 1}),
        ("up % 2", "formula-unsupported", {}),
        ("up.real", "formula-unsupported", {"column": 1}),
        ("up[0]", "formula-unsupported", {}),
        ("lambda: 1", "formula-unsupported", {}),
        ("[x for x in (1, 2)]", "formula-unsupported", {}),
        ("(1, 2)", "formula-unsupported", {}),
        ("f'{up}'", "formula-unsupported", {}),
        ("(x := 3)", "formula-unsupported", {}),
        ("'up'", "not-a-number", {}),
        ("True", "not-a-number", {}),
        ("2j", "not-a-number", {}),
        ("1e999", "number-too-large", {}),
        ("9" * 400, "number-too-large", {}),
        ("sin(up)", "unknown-function", {"name": "sin"}),
        ("__import__('os')", "unknown-function", {"name": "__import__"}),
        ("abs(up, down)", "wrong-argument-count", {"function": "abs"}),
        ("clip(up)", "wrong-argument-count", {"function": "clip"}),
        ("clip(x=up, low=0, high=1)", "wrong-argument-count", {"function": "clip"}),
        ("max(*up)", "wrong-argument-count", {"function": "max"}),
        ("max(1, *up)", "formula-unsupported", {}),
        ("(" * 300 + "up" + ")" * 300, "formula-too-long", {"limit": 500}),
        ("(" * 240 + "up" + ")" * 240, "formula-invalid", {}),
        ("+".join(["up"] * 100), "formula-too-deep", {}),
        ("up + " * 200, "formula-too-long", {"limit": 500}),
        ("up\0", "formula-invalid", {}),
        ("1if up", "formula-invalid", {}),
    ],
)
def test_invalid_formulas_are_refused(text, code, data):
    with raises(ControlError, code, **data) as error:
        compile_expression(text, VALUES)
    assert "\n" not in str(error.value)


@given(st.text(alphabet="updown twist0123456789.+-*/()<>=,clipabsmax", max_size=60))
def test_any_text_gives_a_finite_number_or_an_error(text):
    try:
        formula = compile_expression(text, VALUES)
    except ControlError:
        return
    assert math.isfinite(formula(VALUES))
