"""Cord signals against closed forms and finite differences."""

import numpy as np
import pytest

from defsense_fab.geometry.tetrahedra import tetrahedralise
from defsense_fab.mechanics.locate import PointLocator
from defsense_fab.mechanics.tet10 import QuadraticMesh
from defsense_fab.sensing.signal import signal_gradient, signals

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
def test_imposed_fields_converge_at_third_order_or_better(bar, field):
    """Exact nodal displacements on real meshes; the exact curve by fine quadrature."""
    exact = float(signals(wavy(20000), field(wavy(20000))[None], 1.0)[0])
    sizes, errors = [12.0, 6.0], []
    path = wavy(4000)  # fine, so that only the mesh's error is seen
    for h in sizes:
        mesh = QuadraticMesh.from_linear(tetrahedralise(bar, h))
        locator = PointLocator(mesh)
        at = locator.find(path)
        u = field(mesh.nodes) - mesh.nodes
        got = signals(path, path + locator.displacement(at, u[None]), 1.0)[0]
        errors.append(abs(got / exact - 1))
    assert errors[-1] < 1e-3
    # Quadratic interpolation promises h^2 in the strain, h^3 in u; unstructured meshes scatter.
    assert errors[-1] < errors[0] / 3 or errors[-1] < 1e-6


def test_straight_cords_cannot_tell_the_sense_of_a_twist():
    path = np.stack([np.linspace(2, 148, 200), np.full(200, 6.0), np.full(200, 3.0)], axis=1)
    left, right = signals(path, np.stack([twist(path, 0.7), twist(path, -0.7)]), 2.0)
    assert left > 0
    assert left == pytest.approx(right, rel=1e-9)


def test_rigid_motion_gives_no_signal():
    path = wavy(100)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert np.abs(signals(path, (path @ turn + 5)[None], 2.0)).max() < 1e-12


def test_uniform_stretch_gives_gauge_factor_times_strain():
    path = wavy(50)
    assert signals(path, 1.1 * path[None], 2.0)[0] == pytest.approx(0.2)


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
            high, low = (signals(path + s * e, ((path + s * e) @ F.T)[None], 2.0) for s in (1, -1))
            assert analytic[0, p, d] == pytest.approx((high - low)[0] / (2 * h), abs=1e-8)
