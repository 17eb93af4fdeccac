"""Check that free quantities of a layout are rounded and fixed ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import Hermite, Plane, catmull_rom, sample_path
from defsense_fab.core.device.device import Sensor
from defsense_fab.optimization.problem.cord_parameters import round_layout
from tests.optimization.conftest import search


@pytest.fixture
def cord():
    rng = np.random.default_rng(0)
    points = np.sort(rng.uniform(0, 100, (6, 2)), axis=0)
    plane = Plane.from_normal(*rng.normal(size=(3, 3)) * [[9], [1], [1]])
    return Sensor("a", plane, Hermite(points, catmull_rom(points)), frozenset())


def perturb(sensor, by):
    """Perturb a sensor by as much as results differ between processors."""
    rng = np.random.default_rng(1)
    curve, plane = sensor.curve, sensor.plane
    points, tangents, origin, normal, x_axis = (
        v + by * rng.normal(size=v.shape)
        for v in (curve.points, curve.tangents, plane.origin, plane.normal, plane.axes[:, 0])
    )
    return replace(
        sensor, curve=Hermite(points, tangents), plane=Plane.from_normal(origin, normal, x_axis)
    )


def test_layouts_that_differ_by_rounding_become_equal(cord):
    free = replace(cord, free=frozenset({"path", "plane"}))
    (one,), (other,) = round_layout((free,)), round_layout((perturb(free, 1e-10),))
    assert np.array_equal(one.curve.points, other.curve.points)
    assert np.array_equal(one.curve.tangents, other.curve.tangents)
    assert np.array_equal(one.plane.origin, other.plane.origin)
    assert np.abs(one.plane.axes - other.plane.axes).max() < 1e-15
    assert np.abs(sample_path(one) - sample_path(free)).max() < 5e-4


def test_fixed_quantities_are_not_rounded(cord):
    assert round_layout((cord,))[0].curve is cord.curve
    assert round_layout((cord,))[0].plane is cord.plane
    (path,) = round_layout((replace(cord, free=frozenset({"path"})),))
    assert path.plane is cord.plane
    assert not np.array_equal(path.curve.points, cord.curve.points)
    (tilted,) = round_layout((replace(cord, free=frozenset({"plane"})),))
    assert tilted.curve is cord.curve
    (shifted,) = round_layout((replace(cord, free=frozenset({"offset"})),))
    assert np.array_equal(shifted.plane.axes, cord.plane.axes)
    assert np.abs(shifted.plane.origin - cord.plane.origin).max() <= 5.1e-5


@pytest.mark.parametrize(
    "kinds",
    [
        ("path plane", ""),
        ("", "path plane"),
        ("path",) * 2,
        ("path plane",) * 2,
        ("path plane", "path offset"),
        ("path offset",) * 2,
    ],
)
def test_cords_in_one_slanted_plane_stay_in_it(cord, kinds):
    """The rounding of a direction matters between frames that are 300 mm apart."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        plane = Plane.from_normal(*rng.normal(size=(3, 3)))
        x_axis = plane.axes @ [*rng.normal(size=2), 0]
        away = plane.to_world(rng.normal(size=2) * 300)
        frames = plane, Plane.from_normal(away, plane.normal, x_axis)
        pair = [
            replace(cord, plane=p, free=frozenset(k.split()))
            for p, k in zip(frames, kinds, strict=True)
        ]
        rounded = round_layout(tuple(pair))
        assert rounded[0].plane.coincides(rounded[1].plane)
        assert rounded[1].plane.coincides(rounded[0].plane)
        for before, after in zip(pair, rounded, strict=True):
            assert np.abs(sample_path(after) - sample_path(before)).max() < 1e-3
            assert after.free == before.free
            if not before.free:
                assert after.plane is before.plane


def test_a_search_returns_rounded_layouts(problem):
    found = search(problem, extra=1, starts=1, finalists=1, candidates=500)
    for s in found.sensors:
        values = np.concatenate([s.curve.points.ravel(), s.curve.tangents.ravel(), s.plane.origin])
        assert np.array_equal(values, np.round(values, 4))
