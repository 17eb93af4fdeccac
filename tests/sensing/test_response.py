"""Responses of the cord: values, slopes, and what lies beyond the calibrated strains."""

import json

import numpy as np
import pytest

from defsense_fab.core.errors import CalibrationError
from defsense_fab.core.response import ResponseSpec, read_response
from defsense_fab.sensing.response import Response, respond, response_of
from defsense_fab.sensing.signal import signals
from tests.errors import raises

RANGE = (-0.067, 0.067)
SPECS = {
    "line": ResponseSpec("line", {"k": 1.8}, RANGE),
    "two-slopes": ResponseSpec("two-slopes", {"tension": 2.2, "compression": 1.4}, RANGE),
    "quadratic": ResponseSpec("quadratic", {"k": 2.0, "q": 9.0}, RANGE),
    "cubic": ResponseSpec("cubic", {"k": 2.0, "q": 9.0, "c": -40.0}, RANGE),
    "piecewise": ResponseSpec(
        "piecewise",
        {"strains": [-0.06, -0.03, 0, 0.02, 0.05], "changes": [-0.1, -0.06, 0, 0.03, 0.2]},
        RANGE,
    ),
}


@pytest.fixture(params=SPECS)
def response(request):
    return response_of(SPECS[request.param])


def test_slope_is_the_derivative(response):
    e = np.linspace(-0.2, 0.2, 81) + 1e-4  # off the kinks
    h = 1e-6
    assert response.slope(e) == pytest.approx(
        (response(e + h) - response(e - h)) / (2 * h), abs=1e-6
    )
    assert response(np.array(0.0)) == 0
    assert (response.slope(e) >= 0).all()


def test_loops_see_the_same(response):
    e = np.linspace(-0.2, 0.2, 81) + 1e-4
    where = response.breaks, response.origins, response.pieces
    got = np.array([respond(x, *where) for x in e])
    assert got[:, 0] == pytest.approx(response(e), abs=1e-15)
    assert got[:, 1] == pytest.approx(response.slope(e), abs=1e-15)


def test_values():
    e = np.array([-0.05, 0.05])
    assert response_of(SPECS["line"])(e) == pytest.approx(1.8 * e)
    assert response_of(SPECS["two-slopes"])(e) == pytest.approx([-0.07, 0.11])
    assert response_of(SPECS["quadratic"])(e) == pytest.approx(2 * e + 9 * e**2)
    knots = SPECS["piecewise"].coefficients
    assert response_of(SPECS["piecewise"])(np.array(knots["strains"])) == pytest.approx(
        knots["changes"]
    )


def test_a_quadratic_goes_on_along_its_tangent():
    """By itself this one would fall below -11 %."""
    response = response_of(SPECS["quadratic"])
    edge = np.array(-0.067)
    assert response(edge - 0.3) == pytest.approx(response(edge) - 0.3 * response.slope(edge))


def test_signal_is_the_mean_response():
    """Over the rest length: one third of the cord is stretched by 4 %, the rest pressed by 2 %."""
    rest = np.array([[0.0, 0, 0], [10, 0, 0], [30, 0, 0]])
    moved = np.array([[0.0, 0, 0], [10.4, 0, 0], [30, 0, 0]])
    moved[2, 0] = 10.4 + 19.6
    response = response_of(SPECS["quadratic"])
    expected = (10 * response(np.array(0.04)) + 20 * response(np.array(-0.02))) / 30
    assert signals(rest, moved[None], response)[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("model", "coefficients", "code"),
    [
        ("quartic", {"k": 1}, "unknown-model"),
        ("line", {}, "wrong-coefficients"),
        ("line", {"k": "two"}, "not-a-number"),
        ("line", {"k": float("nan")}, "not-finite"),
        ("quadratic", {"k": 1.0, "q": [1.0]}, "not-finite"),
        ("piecewise", {"strains": [0, 0], "changes": [0, 1]}, "not-monotone"),
        ("piecewise", {"strains": [0, 1], "changes": [0, -1]}, "not-monotone"),
        ("piecewise", {"strains": [0.1, 1], "changes": [0, 1]}, "rest-not-zero"),
        ("piecewise", {"strains": [0, 1], "changes": [0, 1, 2]}, "lists-differ"),
    ],
)
def test_bad_responses(model, coefficients, code):
    with raises(CalibrationError, code):
        ResponseSpec(model, coefficients)


@pytest.mark.parametrize("coefficients", [{"k": 2.0, "q": 5.0}, {"k": 2.0, "q": 5.0, "c": 1.0}])
def test_a_curve_has_rest_in_its_range(coefficients):
    """It goes on straight from the range's ends, and would not be 0 at rest."""
    model = "cubic" if "c" in coefficients else "quadratic"
    with raises(CalibrationError, "rest-outside-range"):
        ResponseSpec(model, coefficients, (0.021, 0.067))
    assert response_of(ResponseSpec(model, coefficients, (0.0, 0.067)))(np.zeros(1)) == 0


def test_files(tmp_path):
    path = tmp_path / "response.json"
    for spec in SPECS.values():
        path.write_text(json.dumps({"schema": 1, **spec.to_json()}))
        assert read_response(path) == spec
    unknown = '{"schema": 1, "model": "x", "coefficients": {}, "strain_range": [0, 1]}'
    for text, code in (
        ("{", "not-json"),
        ("[]", "bad-response-file"),
        ('{"schema": 2}', "wrong-schema"),
        ('{"schema": 1, "model": "line"}', "bad-response-file"),
        (unknown, "unknown-model"),
    ):
        path.write_text(text)
        with raises(CalibrationError, code):
            read_response(path)
    with raises(CalibrationError, "file-not-found", path=tmp_path / "none.json"):
        read_response(tmp_path / "none.json")


def test_a_line_has_one_slope():
    assert Response.line(2.0).slope_everywhere == 2.0
    assert response_of(SPECS["two-slopes"]).slope_everywhere is None
