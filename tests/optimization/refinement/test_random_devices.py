"""Optimize random devices: every result keeps every limit, or the device is refused.

DEFSENSE_RANDOM_DEVICES sets their number; 200 take about three minutes.
"""

import os
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from defsense_fab.core.curve import Hermite, Plane, catmull_rom, distinct_planes
from defsense_fab.core.device.device import DECODERS, Sensor
from defsense_fab.core.errors import LayoutError
from defsense_fab.core.mesh import TetMesh
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.problem.cord_signals import SignalModel
from defsense_fab.optimization.problem.problem import Limits, Problem
from defsense_fab.optimization.refinement.refine import layout_error, optimize_layout
from defsense_fab.optimization.search.starting_layouts import LayoutSearch
from defsense_fab.sensing.response import Response
from tests.conftest import structured_bar

pytestmark = pytest.mark.slow

COUNT = int(os.environ.get("DEFSENSE_RANDOM_DEVICES", "30"))
_TOLERANCE = 0.05  # mm


def body(rng):
    """Return a box of random proportions, tapered, bulged and bent, as tets and surface."""
    size = rng.uniform([60, 24, 20], [180, 60, 40])
    mesh = structured_bar([0, -0.5, -0.5], [1, 0.5, 0.5], [12, 4, 4])
    x, y, z = mesh.nodes.T
    girth = 1 + rng.uniform(-0.35, 0.35) * (x - 0.5) + rng.uniform(0, 0.4) * np.sin(np.pi * x)
    round_off = 1 - rng.uniform(0, 0.5) * (y * z) ** 2 * 4
    lift = rng.uniform(-0.4, 0.4) * size[2] * np.sin(np.pi * x)
    nodes = np.stack(
        [size[0] * x, size[1] * y * girth * round_off, size[2] * z * girth * round_off + lift], 1
    )
    mesh = TetMesh(nodes, mesh.tets)
    return mesh, mesh.boundary(), size


def fields(rng, points, size, draw):
    """Return random bends, twists, pulls and a smooth wave, (s, p, 3)."""
    x = points[:, 0] / size[0]
    y, z = points[:, 1], points[:, 2]
    out = []
    for bend, sway, twist, pull, wave in draw:
        u = np.stack([pull * x * 8, bend * x**2 * 15, sway * x**2 * 15], axis=1)
        u[:, 0] -= (bend * y + sway * z) * 30 * x / size[0]
        u += twist * 0.5 * x[:, None] * np.stack([0 * y, -z, y], axis=1)
        u[:, 2] += wave * 3 * np.sin(np.pi * x) * y / size[1]
        out.append(u)
    return np.stack(out)


def device(rng):
    mesh, surface, size = body(rng)
    draw = rng.normal(0, 0.6, (rng.integers(3, 9), 5))
    quadratic = QuadraticMesh.from_linear(mesh)
    points = surface.vertices[rng.choice(len(surface.vertices), 30, replace=False)]
    markers = np.concatenate([np.zeros((1, 30, 3)), fields(rng, points, size, draw)])
    diameter = rng.uniform(1.5, 2.5)
    wall = rng.uniform(0.8, 1.6)
    return Problem(
        surface,
        PointLocator(quadratic),
        fields(rng, quadratic.nodes, size, draw),
        markers,
        np.full(30, 1 / 30),
        SignalModel(Response.line(2.0)),
        float(rng.choice([0.0, 0.002, 0.01])),
        Limits(wall, rng.uniform(3, 8), diameter + wall, diameter),
        str(rng.choice(DECODERS)),
    ), size


def drawing(rng, size, count):
    """Return straight cords at random places along the body; not all of them fit."""
    out = []
    for i in range(count):
        at = np.array([0, *(rng.uniform(-0.35, 0.35, 2) * size[1:])])
        x = np.array([2, 10, *np.linspace(0.2, 0.8, 4) * size[0], size[0] - 10, size[0] - 2])
        points = np.stack([x, np.zeros(8)], axis=1)
        normal = rng.normal(size=3) * [0.05, 1, 1]
        free = [["path"], ["path", "plane"], ["plane"], []][rng.integers(4)]
        plane = Plane.from_normal(at, normal, np.array([1.0, 0, 0]))
        out.append(Sensor(f"c{i}", plane, Hermite(points, catmull_rom(points)), frozenset(free)))
    return out


def min_gap(a, b):
    return cKDTree(a).query(b)[0].min()


@cache
def has_layout(seed):
    """Return whether a random device gets a layout, and check it, or its refusal."""
    rng = np.random.default_rng(seed)
    problem, size = device(rng)
    if rng.random() < 0.3:  # only a range of cord lengths is available
        lengths = sorted(rng.uniform(0.6, 1.4, 2) * size[0])
        bounds = replace(problem.limits, shortest=lengths[0], longest=lengths[1])
        problem = replace(problem, limits=bounds)
    drawn = drawing(rng, size, int(rng.integers(0, 3)))
    extra = int(rng.integers(0 if drawn else 1, 3))
    planes = [None, 1][int(rng.integers(2))]
    search = LayoutSearch(extra, planes, starts=2, finalists=1, candidates=1500)
    refusal = None
    try:
        found = optimize_layout(problem, drawn, rng, lambda f, m: None, search)
    except LayoutError as error:
        refusal = error
    broken = verify(drawn, problem.surface, problem.limits).violations
    if broken or refusal:
        assert refusal.code == (broken[0].code if broken else "no-room-for-cords")
        assert not broken or refusal.data["cords"] == broken[0].cords
        drawn_planes = len(distinct_planes([s.plane for s in drawn]))
        assert broken or refusal.data["planes"] == (planes and max(planes, drawn_planes))
        return False
    allowed = max(planes or len(found.sensors), len(distinct_planes([s.plane for s in drawn])))
    assert len(distinct_planes([s.plane for s in found.sensors])) <= allowed
    limits = problem.limits
    slack = replace(
        limits,
        wall=limits.wall - _TOLERANCE,
        min_radius=limits.min_radius - _TOLERANCE,
        clearance=limits.clearance - _TOLERANCE,
        shortest=limits.shortest - _TOLERANCE,
        longest=limits.longest + _TOLERANCE,
    )
    assert verify(found.sensors, problem.surface, slack).violations == ()
    assert len(found.sensors) == len(drawn) + extra
    paths = [s.plane.to_world(s.curve.sample(200)) for s in found.sensors]
    for i, path in enumerate(paths):
        for other in paths[:i]:
            assert min_gap(path, other) > limits.clearance - _TOLERANCE
    for before, after in zip(drawn, found.sensors, strict=False):
        assert after.name == before.name
        if "plane" not in before.free:
            assert after.plane.axes == pytest.approx(before.plane.axes)
        if not before.free:
            assert after.curve.points == pytest.approx(before.curve.points)
    assert found.rmse == pytest.approx(layout_error(problem, found.sensors))
    if drawn and not extra:
        assert found.rmse <= layout_error(problem, drawn) or not found.slivers
    return True


@pytest.mark.parametrize("seed", range(COUNT))
def test_results_keep_the_limits_or_have_a_reason(seed):
    has_layout(seed)


def test_most_devices_get_a_layout():
    """Measured: 83 of 120, 18 to 25 of any thirty; in the others the drawing does not fit."""
    assert sum(has_layout(seed) for seed in range(COUNT)) >= COUNT // 2
