"""Cord signals against closed forms and finite differences."""

import numpy as np
import pytest

from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralise
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.sensing.response import Response
from defsense_fab.sensing.signal import relative_change, signals
from tests.sensing.reference import signal_gradient

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


@pytest.mark.slow
@pytest.mark.parametrize("field", [bend, twist])
def test_imposed_fields_converge_as_quadratic_elements_promise(bar, field):
    """Exact nodal displacements on real meshes against quadrature of the exact curve, for 30
    paths: h^3 in the displacement, at least h^2 in the signal, a derivative's mean."""
    rng = np.random.default_rng(0)
    t = np.linspace(0, 1, 2000)  # fine, so that only the mesh's error is seen
    y, z = rng.uniform(-6, 6, (2, 30, 3, 1))
    waves = np.sin(np.pi * t), np.sin(2 * np.pi * t), np.sin(3 * np.pi * t)
    y = y[:, 0] + y[:, 1] * waves[0] + 0.3 * y[:, 2] * waves[1]
    z = z[:, 0] + 0.7 * z[:, 1] * waves[0] + 0.2 * z[:, 2] * waves[2]
    paths = np.stack([np.broadcast_to(2 + 146 * t, y.shape), y, z], axis=-1)
    exact = signals(paths, field(paths)[None], Response.line(1.0))[0]
    sizes, errors = [], []
    for edge_length in (12.0, 8.5, 6.0, 4.25):
        mesh = tetrahedralise(bar, edge_length).mesh
        quadratic = QuadraticMesh.from_linear(mesh)
        locator = PointLocator(quadratic)
        u = (field(quadratic.nodes) - quadratic.nodes)[None]
        found = locator.displacement(locator.find(paths.reshape(-1, 3)), u).reshape(paths.shape)
        got = signals(paths, (paths + found)[None], Response.line(1.0))[0]
        off = np.sqrt(((field(paths) - paths - found) ** 2).sum(-1).mean())
        sizes.append(np.cbrt(mesh.volumes.mean()))
        errors.append([off, np.sqrt(((got - exact) ** 2).sum() / (exact**2).sum())])
        if edge_length <= 6:
            assert np.abs(got / exact - 1)[np.abs(exact) > 0.1 * np.abs(exact).max()].max() < 1e-3
    displacement, signal = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert displacement > 2.7
    assert signal > 2.0


def test_straight_cords_cannot_tell_the_sense_of_a_twist():
    path = np.stack([np.linspace(2, 148, 200), np.full(200, 6.0), np.full(200, 3.0)], axis=1)
    left, right = signals(path, np.stack([twist(path, 0.7), twist(path, -0.7)]), Response.line(2.0))
    assert left > 0
    assert left == pytest.approx(right, rel=1e-9)


def test_rigid_motion_gives_no_signal():
    path = wavy(100)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert np.abs(signals(path, (path @ turn + 5)[None], Response.line(2.0))).max() < 1e-12


def test_uniform_stretch_gives_gauge_factor_times_strain():
    path = wavy(50)
    assert signals(path, 1.1 * path[None], Response.line(2.0))[0] == pytest.approx(0.2)


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
                signals(path + s * e, ((path + s * e) @ F.T)[None], Response.line(2.0))
                for s in (1, -1)
            )
            assert analytic[0, p, d] == pytest.approx((high - low)[0] / (2 * h), abs=1e-8)


def test_relative_change_is_by_channel_and_keeps_what_is_not_known():
    resistance = np.array([[110.0, 180.0], [np.nan, np.inf]])
    change = relative_change(resistance, np.array([100.0, 200.0]))
    assert change == pytest.approx(np.array([[0.1, -0.1], [np.nan, np.inf]]), nan_ok=True)
