"""Solids of a block with printed traces."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from defsense_fab.core.curve import REST_FRAME, Hermite, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.core.device.pads import PADS
from defsense_fab.core.errors import FabricationError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.channels.cord_channels import make_trace_lines
from defsense_fab.geometry.kernels import triangle_kernel
from defsense_fab.geometry.parts.printed_traces import TraceShape, make_printed, sweep_trace
from defsense_fab.geometry.parts.records import PartRules
from tests.support.errors import raises

UP = np.array([0.0, 0.0, 1.0])
PIN = PADS["spring-pin"]
SHAPE = TraceShape(1.2, 0.8, UP, PIN)
RULES = PartRules(cord=1.44, channel=1.44, clearance=0.2, wall=1.2)


def block():
    box = trimesh.creation.box((60.0, 20.0, 10.0))
    return Surface(np.asarray(box.vertices, float), np.asarray(box.faces, np.int64))


def trace(name, points):
    points = np.array(points, float)
    return Sensor(name, REST_FRAME, Hermite(points, catmull_rom(points)))


def straight(name, y, z=0.0):
    return trace(name, [[-28, y, z], [-10, y, z], [10, y, z], [28, y, z]])


def make(*traces, pad=PIN, surface=None):
    surface = surface or block()
    lines = make_trace_lines(traces, surface, 1.2, pad.depth)
    return make_printed(surface, lines, RULES, TraceShape(1.2, 0.8, UP, pad))


def volume_of_holes(pad):
    section = np.pi / 4 * pad.hole_diameter**2
    if not pad.hole_spacing:
        return section * pad.hole_depth
    # A square tunnel whose ends are half cylinders joins the holes.
    bridged = pad.hole_spacing * pad.hole_diameter - section
    return 2 * section * pad.hole_depth + bridged * pad.hole_diameter


@pytest.mark.parametrize(
    ("direction", "area"),
    [((1, 0, 0), 1.2 * 0.8), ((1, 1, 0), 1.2 * 0.8), ((0, 0, 1), np.pi / 4 * 1.2**2)],
)
def test_the_section_of_a_sweep(direction, area):
    """A level trace is a bar with round ends; a vertical one is a cylinder."""
    line = np.linspace(0, 20, 3)[:, None] * (np.array(direction) / np.linalg.norm(direction))
    ends = np.pi / 4 * 1.2**2 * 0.8
    assert float(sweep_trace(line, SHAPE).volume()) == pytest.approx(20 * area + ends, rel=0.03)


def test_a_trace_is_strained_from_skin_to_skin():
    """It is bonded; the cord of a channel is not strained outside of its path."""
    (channel,) = make_trace_lines([straight("a", -4)], block(), 1.2, PIN.depth)
    assert channel.sensing[[0, -1]] == pytest.approx(np.array([[-30, -4, 0], [30, -4, 0]]))
    assert replace(channel, is_trace=False).sensing[[0, -1], 0] == pytest.approx([-28, 28])


def test_body_and_traces_fill_the_block():
    parts = make(straight("a", -4), trace("b", [[-28, 4, -2], [-8, 4, -2], [8, 4, 2], [28, 4, 2]]))
    assert [p.name for p in parts.traces] == ["a", "b"]
    (body,) = parts.parts
    filled = body.volume + sum(t.volume for t in parts.traces)
    assert filled == pytest.approx(12000 - 4 * volume_of_holes(PIN), rel=1e-4)
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in (body, *parts.traces)]
    for i in range(3):
        for j in range(i):
            assert float((solids[i] ^ solids[j]).volume()) < 1e-3
    assert all(check.holds for check in parts.checks)
    assert not parts.cuts


@pytest.mark.parametrize("pad", PADS.values(), ids=PADS)
def test_pads_reach_the_skin_and_have_their_holes(pad):
    """The holes are in the filament of the pads only, so that the body stays as it is."""
    parts = make(straight("a", 0), pad=pad)
    (trace,), (body,) = parts.traces, parts.parts
    assert trace.surface.bounds[:, 0] == pytest.approx([-30, 30], abs=1e-3)
    cylinder = np.pi / 4 * pad.diameter**2 * pad.depth
    expected = 1.2 * 0.8 * (60 - 2 * pad.depth) + 2 * (cylinder - volume_of_holes(pad))
    assert trace.volume == pytest.approx(expected, rel=0.02)
    total = 12000 - 2 * volume_of_holes(pad)
    assert body.volume + trace.volume == pytest.approx(total, rel=1e-4)


def test_a_pad_on_a_bend_of_the_skin_is_noted():
    """At the edge of an eyelet of 6 mm, a rod of radius 10 mm is 0.44 mm below its tangent."""
    rod = trimesh.creation.cylinder(10.0, 60.0, sections=96)
    surface = Surface(np.asarray(rod.vertices, float), np.asarray(rod.faces, np.int64))
    across = trace("a", [[-8, 0, 0], [-3, 0, 0], [3, 0, 0], [8, 0, 0]])
    places = np.array(list(make(across, pad=PADS["eyelet"], surface=surface).warnings.values()))
    assert np.sort(places[:, 0]) == pytest.approx([-10, 10], abs=0.1)
    assert not make(across, pad=PADS["spring-pin"], surface=surface).warnings
    assert not make(straight("a", 0), pad=PADS["eyelet"]).warnings


def test_a_pad_across_an_edge_is_refused():
    with raises(FabricationError, "pad-outside", trace="a"):
        make(straight("a", 8.0, z=3.0), pad=PADS["thread"])


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
    assert area == pytest.approx(np.pi / 4 * (PIN.diameter**2 - PIN.hole_diameter**2), rel=0.02)
