"""Responses of the cord: values, slopes, and what lies beyond the calibrated strains."""

from __future__ import annotations

import json

import numpy as np
import pytest

from defsense_fab.core.errors import CalibrationError
from defsense_fab.core.response import ResponseSpec, read_response
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.sensing.response import (
    Response,
    build_response,
    cord_signals,
    relative_change,
)

from ..support.errors import raises
from .reference import signal_gradient

# Cord signals against closed forms and finite differences.

LENGTH = 150.0


def bend(p, angle=np.pi / 6):
    """Exact constant-curvature bend of the bar's axis: plane sections stay plane."""
    radius = LENGTH / angle
    a = p[..., 0] / radius
    r = radius - p[..., 2]
    return np.stack([r * np.sin(a), p[..., 1], radius - r * np.cos(a)], axis=-1)


def twist(p, angle=np.pi / 4):
    a = angle * p[..., 0] / LENGTH
    y, z = p[..., 1], p[..., 2]
    return np.stack([p[..., 0], y * np.cos(a) - z * np.sin(a), y * np.sin(a) + z * np.cos(a)], -1)


def wavy(n):
    t = np.linspace(0, 1, n)
    return np.stack([2 + 146 * t, 9 * np.sin(2 * np.pi * t), 5 + 6 * np.sin(np.pi * t)], axis=-1)


@pytest.fixture(scope="module")
def refined(bar):
    """Return meshes with shorter and shorter edges, by their edge length, mm."""
    return {h: tetrahedralize(bar, h).mesh for h in (12.0, 8.5, 6.0, 4.25)}


@pytest.mark.slow
@pytest.mark.parametrize("field", [bend, twist])
def test_signals_of_exact_fields_converge_with_the_expected_rates(refined, field):
    """Exact nodal displacements on real meshes against quadrature of the exact curve, for 30
    paths: h^3 in the displacement, at least h^2 in the signal, a derivative's mean."""
    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, 2000)  # fine, so that only the mesh's error is seen
    y, z = rng.uniform(-6, 6, (2, 30, 3, 1))
    waves = np.sin(np.pi * t), np.sin(2 * np.pi * t), np.sin(3 * np.pi * t)
    y = y[:, 0] + y[:, 1] * waves[0] + 0.3 * y[:, 2] * waves[1]
    z = z[:, 0] + 0.7 * z[:, 1] * waves[0] + 0.2 * z[:, 2] * waves[2]
    paths = np.stack([np.broadcast_to(2 + 146 * t, y.shape), y, z], axis=-1)
    exact = cord_signals(paths, field(paths)[None], Response.line(1.0))[0]
    sizes, errors = [], []
    for edge_length, mesh in refined.items():
        quadratic = QuadraticMesh.from_linear(mesh)
        locator = PointLocator(quadratic)
        u = (field(quadratic.nodes) - quadratic.nodes)[None]
        found = locator.displacement(locator.find(paths.reshape(-1, 3)), u).reshape(paths.shape)
        result = cord_signals(paths, (paths + found)[None], Response.line(1.0))[0]
        off = np.sqrt(((field(paths) - paths - found) ** 2).sum(-1).mean())
        sizes.append(np.cbrt(mesh.volumes.mean()))
        errors.append([off, np.sqrt(((result - exact) ** 2).sum() / (exact**2).sum())])
        if edge_length <= 6:
            assert (
                np.abs(result / exact - 1)[np.abs(exact) > 0.1 * np.abs(exact).max()].max() < 1e-3
            )
    displacement, signal = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert displacement > 2.7
    assert signal > 2.0


def test_straight_cords_do_not_distinguish_the_sense_of_a_twist():
    path = np.stack([np.linspace(2, 148, 200), np.full(200, 6.0), np.full(200, 3.0)], axis=1)
    left, right = cord_signals(
        path, np.stack([twist(path, 0.7), twist(path, -0.7)]), Response.line(2.0)
    )
    assert left > 0
    assert left == pytest.approx(right, rel=1e-9)


def test_rigid_motion_gives_no_signal():
    path = wavy(100)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert np.abs(cord_signals(path, (path @ turn + 5)[None], Response.line(2.0))).max() < 1e-12


def test_uniform_stretch_gives_gauge_factor_times_strain():
    path = wavy(50)
    assert cord_signals(path, 1.1 * path[None], Response.line(2.0))[0] == pytest.approx(0.2)


def test_gradient_by_finite_differences():
    G = np.random.default_rng(1).normal(0, 0.2, (3, 3))
    F = np.eye(3) + G
    path = wavy(12)
    gradients = np.broadcast_to(F, (1, len(path), 3, 3))
    _, analytic = signal_gradient(path, (path @ F.T)[None], gradients, 2.0)
    h = 1e-6
    for p in range(len(path)):
        for d in range(3):
            e = np.zeros_like(path)
            e[p, d] = h
            high, low = (
                cord_signals(path + s * e, ((path + s * e) @ F.T)[None], Response.line(2.0))
                for s in (1, -1)
            )
            assert analytic[0, p, d] == pytest.approx((high - low)[0] / (2 * h), abs=1e-8)


def test_relative_change_by_channel_keeps_nan_and_inf():
    resistance = np.array([[110.0, 180.0], [np.nan, np.inf]])
    change = relative_change(resistance, np.array([100.0, 200.0]))
    assert change == pytest.approx(np.array([[0.1, -0.1], [np.nan, np.inf]]), nan_ok=True)


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
    return build_response(SPECS[request.param])


def test_slope_is_the_derivative(response):
    e = np.linspace(-0.2, 0.2, 81) + 1e-4  # off the kinks
    h = 1e-6
    assert response.slope(e) == pytest.approx(
        (response(e + h) - response(e - h)) / (2 * h), abs=1e-6
    )
    assert response(np.array(0.0)) == 0
    assert (response.slope(e) >= 0).all()


def test_values_of_each_model():
    e = np.array([-0.05, 0.05])
    assert build_response(SPECS["line"])(e) == pytest.approx(1.8 * e)
    assert build_response(SPECS["two-slopes"])(e) == pytest.approx([-0.07, 0.11])
    assert build_response(SPECS["quadratic"])(e) == pytest.approx(2 * e + 9 * e**2)
    knots = SPECS["piecewise"].coefficients
    assert build_response(SPECS["piecewise"])(np.array(knots["strains"])) == pytest.approx(
        knots["changes"]
    )


def test_quadratic_continues_along_its_tangent():
    """Without the tangent it would decrease below -11 %."""
    response = build_response(SPECS["quadratic"])
    edge = np.array(-0.067)
    assert response(edge - 0.3) == pytest.approx(response(edge) - 0.3 * response.slope(edge))


def test_signal_is_the_mean_response():
    """One third of the cord is stretched by 4 %, the rest is compressed by 2 %."""
    rest = np.array([[0.0, 0, 0], [10, 0, 0], [30, 0, 0]])
    moved = np.array([[0.0, 0, 0], [10.4, 0, 0], [30, 0, 0]])
    moved[2, 0] = 10.4 + 19.6
    response = build_response(SPECS["quadratic"])
    expected = (10 * response(np.array(0.04)) + 20 * response(np.array(-0.02))) / 30
    assert cord_signals(rest, moved[None], response)[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("model", "coefficients", "code"),
    [
        ("quartic", {"k": 1}, "unknown-model"),
        ("line", {}, "wrong-coefficients"),
        ("line", {"k": "two"}, "not-a-number"),
        ("line", {"k": float("nan")}, "not-finite"),
        ("quadratic", {"k": 1.0, "q": [1.0]}, "not-finite"),
        ("piecewise", {"strains": [0, 0], "changes": [0, 1]}, "not-monotone"),
        ("piecewise", {"strains": [-1, 0, 1], "changes": [1, 0, 1]}, "not-monotone"),
        ("piecewise", {"strains": [0.1, 1], "changes": [0, 1]}, "rest-not-zero"),
        ("piecewise", {"strains": [0, 1], "changes": [0, 1, 2]}, "lists-differ"),
    ],
)
def test_invalid_response_is_refused(model, coefficients, code):
    with raises(CalibrationError, code):
        ResponseSpec(model, coefficients)


@pytest.mark.parametrize("coefficients", [{"k": 2.0, "q": 5.0}, {"k": 2.0, "q": 5.0, "c": 1.0}])
def test_polynomial_needs_rest_in_its_range(coefficients):
    """It is linear beyond the range's ends, and would not be 0 at rest."""
    model = "cubic" if "c" in coefficients else "quadratic"
    with raises(CalibrationError, "rest-outside-range"):
        ResponseSpec(model, coefficients, (0.021, 0.067))
    assert build_response(ResponseSpec(model, coefficients, (0.0, 0.067)))(np.zeros(1)) == 0


def test_response_files(tmp_path):
    path = tmp_path / "response.json"
    for spec in SPECS.values():
        path.write_text(json.dumps({"schema": 1, **spec.to_json()}))
        assert read_response(path) == spec
    unknown = '{"schema": 1, "model": "x", "coefficients": {}, "strain_range": [0, 1]}'
    for text, code in (
        ("{", "not-json"),
        ("[]", "response-file-invalid"),
        ('{"schema": 2}', "wrong-schema"),
        ('{"schema": 1, "model": "line"}', "response-file-invalid"),
        (unknown, "unknown-model"),
    ):
        path.write_text(text)
        with raises(CalibrationError, code):
            read_response(path)
    with raises(CalibrationError, "file-not-found", path=tmp_path / "none.json"):
        read_response(tmp_path / "none.json")


def test_only_a_line_has_a_linear_slope():
    assert Response.line(2.0).linear_slope == 2.0
    assert build_response(SPECS["two-slopes"]).linear_slope is None
