"""Solids of a block with printed traces."""

import numpy as np
import pytest
import trimesh

from defsense_fab.core.curve import REST_FRAME, Hermite, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.errors import FabricationError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.channels.cord_channels import make_trace_lines
from defsense_fab.geometry.kernels import triangle_kernel
from defsense_fab.geometry.parts.printed_traces import (
    PAD_DEPTH_MM,
    PAD_DIAMETER_MM,
    TraceShape,
    make_printed,
    sweep_trace,
)
from defsense_fab.geometry.parts.records import PartRules
from tests.support.errors import raises

UP = np.array([0.0, 0.0, 1.0])
SHAPE = TraceShape(1.2, 0.8, UP)
RULES = PartRules(cord=1.44, channel=1.44, clearance=0.2, wall=1.2)


def block():
    box = trimesh.creation.box((60.0, 20.0, 10.0))
    return Surface(np.asarray(box.vertices, float), np.asarray(box.faces, np.int64))


def trace(name, points):
    points = np.array(points, float)
    return Sensor(name, REST_FRAME, Hermite(points, catmull_rom(points)))


def straight(name, y, z=0.0):
    return trace(name, [[-28, y, z], [-10, y, z], [10, y, z], [28, y, z]])


def make(*traces):
    surface = block()
    return make_printed(surface, make_trace_lines(traces, surface, 1.2), RULES, SHAPE)


@pytest.mark.parametrize(
    ("direction", "area"),
    [((1, 0, 0), 1.2 * 0.8), ((1, 1, 0), 1.2 * 0.8), ((0, 0, 1), np.pi / 4 * 1.2**2)],
)
def test_the_section_of_a_sweep(direction, area):
    """A level trace is a bar with round ends; a vertical one is a cylinder."""
    line = np.linspace(0, 20, 3)[:, None] * (np.array(direction) / np.linalg.norm(direction))
    ends = np.pi / 4 * 1.2**2 * 0.8
    assert float(sweep_trace(line, SHAPE).volume()) == pytest.approx(20 * area + ends, rel=0.03)


def test_body_and_traces_fill_the_block():
    parts = make(straight("a", -4), trace("b", [[-28, 4, -2], [-8, 4, -2], [8, 4, 2], [28, 4, 2]]))
    assert [p.name for p in parts.traces] == ["a", "b"]
    (body,) = parts.parts
    assert body.volume + sum(t.volume for t in parts.traces) == pytest.approx(12000, rel=1e-4)
    pads = 2 * np.pi / 4 * PAD_DIAMETER_MM**2 * PAD_DEPTH_MM
    expected = 1.2 * 0.8 * (60 - 2 * PAD_DEPTH_MM) + pads
    assert parts.traces[0].volume == pytest.approx(expected, rel=0.02)
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in (body, *parts.traces)]
    for i in range(3):
        for j in range(i):
            assert float((solids[i] ^ solids[j]).volume()) < 1e-3
    assert all(check.holds for check in parts.checks)
    assert not parts.cuts


def test_pads_reach_the_skin():
    parts = make(straight("a", 0))
    assert parts.traces[0].surface.bounds[:, 0] == pytest.approx([-30, 30], abs=1e-3)


def test_traces_whose_pads_touch_are_refused():
    with raises(FabricationError, "traces-touch", traces=("a", "b")):
        make(straight("a", -1.9), straight("b", 1.9))


def test_a_trace_outside_of_the_body_is_refused():
    with raises(FabricationError, "path-leaves-body"):
        make(straight("a", 12))


def test_the_pad_of_a_slanted_trace_is_level_with_the_skin():
    """All of its face shows, although the trace leaves the body at 45 degrees."""
    parts = make(trace("a", [[-28, 0, 0], [-10, 0, 0], [10, 0, 0], [22, 0, 0], [26, 0, 4]]))
    surface = parts.traces[0].surface
    corners = surface.vertices[surface.faces]
    is_on_top = (corners[:, :, 2] > 5 - 1e-6).all(axis=1)
    a, b, c = (corners[is_on_top, i] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(np.pi / 4 * PAD_DIAMETER_MM**2, rel=0.02)
