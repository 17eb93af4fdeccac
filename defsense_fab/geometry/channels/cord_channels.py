"""Make the cords' channels from skin to skin, with their ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import arc_lengths, bend_radius, per_span_for_sag, resample, sample_path
from ...core.device.device import Sensor
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..kernels import surface_queries, triangle_kernel
from ..kernels.cutting_tools import Tool, cylinder
from ..kernels.surface_queries import signed_distance_of
from .channel_ends import End, Pockets, make_end_tools, plan_ends
from .wire_channels import Hollow, Lead

SAMPLE_STEP_MM = 0.25  # between samples of a channel
MAX_SAG_MM = 0.004  # between a channel's chords and the path


@dataclass(frozen=True)
class Channel:
    """A cord's channel.

    Attributes:
        sensor: The cord.
        line: Center line (p, 3) with the tool's runs out of the body, mm.
        inside: Center line (q, 3) from mouth to mouth, mm.
        inlets: Straight runs from the path's ends to the skin, mm.
        runs: How far the tool continues from the path's ends, mm.
        ends: Both ends.
        tools: Tools that shape the ends.
        solid: The whole channel with the wires' leads, for manifold3d; None for a printed trace.
        is_trace: Whether it is the line of a printed trace, which is bonded up to the skin.
    """

    sensor: Sensor
    line: Float
    inside: Float
    inlets: tuple[float, float]
    runs: tuple[float, float]
    ends: tuple[End, End]
    tools: tuple[Tool, ...]
    solid: Any
    is_trace: bool = False

    @property
    def noun(self) -> str:
        """What texts call it: "trace" or "cord"."""
        return "trace" if self.is_trace else "cord"

    @property
    def name(self) -> str:
        return self.sensor.name

    @property
    def length(self) -> float:
        """Length from mouth to mouth, mm."""
        return float(np.linalg.norm(np.diff(self.inside, axis=0), axis=1).sum())

    @property
    def between(self) -> float:
        """Length that is not in pockets, mm: the least that a cord has between its ferrules."""
        return self.length - sum(e.pocket for e in self.ends)

    @property
    def sensing(self) -> Float:
        """The part (p, 3) of a cord that is strained, mm, with points as dense as in `sample_path`.

        Of a cord it is the path outside of its pockets, without the straight runs to the skin. Of a
        trace it is the whole line.
        """
        path = sample_path(self.sensor)
        if self.is_trace:
            count = round(len(path) * self.length / float(arc_lengths(path)[-1]))
            return resample(self.inside, 0.0, self.length, count)
        hidden = [max(0.0, e.pocket - i) for e, i in zip(self.ends, self.inlets, strict=True)]
        return resample(path, hidden[0], float(arc_lengths(path)[-1]) - hidden[1], len(path))

    def hollows(self, diameter: float, pockets: Pockets | None) -> list[Hollow]:
        """Return points (n, 3) along each hollow and its radius, mm."""
        out = [(self.inside, diameter / 2)]
        for end in self.ends:
            out += end.hollows(pockets)
        return out

    @property
    def leads(self) -> list[Lead]:
        """The existing leads."""
        return [end.lead for end in self.ends if end.lead]

    @property
    def insides(self) -> list[Float]:
        """Center lines (p, 3) of the channel and its leads in the body, mm."""
        return [self.inside, *(lead.inside for lead in self.leads)]

    @property
    def lines(self) -> list[Float]:
        """Center lines (p, 3) of the channel and its leads with the tools' runs, mm."""
        return [self.line, *(lead.line for lead in self.leads)]

    def cord(self, diameter: float) -> Any:
        """Return a solid of the cord itself, along the path and its straight runs out of the body.
        It is finer than the channel that it is checked in.
        """
        path = sample_path(self.sensor, 2 * per_span_for_sag(self.sensor.curve, MAX_SAG_MM))
        line = np.concatenate([self.line[:1], path, self.line[-1:]])
        return triangle_kernel.tube(line, self.sensor.plane.normal, diameter, sides=24)

    def wires(self, diameter: float) -> list[Any]:
        """Return solids of the wires in their leads."""
        normal = self.sensor.plane.normal
        out = [triangle_kernel.tube(lead.line, normal, diameter, sides=24) for lead in self.leads]
        return out + [
            triangle_kernel.solid_of(cylinder(lead.exit, lead.exit + lead.drop, diameter))
            for lead in self.leads
            if lead.drop is not None
        ]


def make_channels(
    sensors: Sequence[Sensor],
    body: Surface,
    diameter: float,
    wall: float,
    pockets: Pockets | None,
) -> list[Channel]:
    """Make the channel of every cord.

    Args:
        sensors: The cords.
        body: Surface of the body.
        diameter: Diameter of the channels, mm.
        wall: Least wall between hollows, mm.
        pockets: Pockets at the ends, or None.

    Raises:
        FabricationError: If a path leaves the body or bends too tightly for a channel.
    """
    traces = [_trace(s, body, diameter) for s in sensors]
    planes = [s.plane for s in sensors]
    ends = plan_ends(planes, [t.inside for t in traces], diameter, wall, body, pockets)
    out = []
    for s, t, ends_pair in zip(sensors, traces, ends, strict=True):
        tools = tuple(
            tool for e in ends_pair for tool in make_end_tools(e, diameter, wall, pockets)
        )
        tubes = [triangle_kernel.tube(t.line, s.plane.normal, diameter)]
        if pockets and pockets.wires:
            wire_diameter = pockets.wires.diameter
            tubes += [
                triangle_kernel.tube(e.lead.line, s.plane.normal, wire_diameter)
                for e in ends_pair
                if e.lead
            ]
        solid = triangle_kernel.union([*tubes, *(triangle_kernel.solid_of(tool) for tool in tools)])
        out.append(Channel(s, t.line, t.inside, t.inlets, t.runs, ends_pair, tools, solid))
    return out


def make_trace_lines(
    sensors: Sequence[Sensor], body: Surface, width: float, pad_depth: float
) -> list[Channel]:
    """Return the lines of printed traces from skin to skin, without a channel's solids.

    Args:
        sensors: The traces.
        body: Surface of the body.
        width: Width of the traces, mm.
        pad_depth: Depth of the pads at their ends, which take the place of pockets, mm.

    Raises:
        FabricationError: If a path leaves the body or bends too tightly.
    """
    out = []
    for sensor in sensors:
        t = _trace(sensor, body, width, "trace")
        mouths = [(t.inside[0], t.inside[1]), (t.inside[-1], t.inside[-2])]
        first, last = (End(a, (a - b) / np.linalg.norm(a - b), pad_depth, "") for a, b in mouths)
        ends = (first, last)
        out.append(Channel(sensor, t.line, t.inside, t.inlets, t.runs, ends, (), None, True))
    return out


@dataclass(frozen=True)
class _Trace:
    """A channel's lines, as in `Channel`."""

    line: Float
    inside: Float
    inlets: tuple[float, float]
    runs: tuple[float, float]


def _trace(sensor: Sensor, body: Surface, diameter: float, noun: str = "cord") -> _Trace:
    """Extend a path straight to the skin on both sides."""
    path = sample_path(sensor, per_span_for_sag(sensor.curve, MAX_SAG_MM))
    _check_path(sensor, path, body, diameter, noun)
    tangents = sensor.plane.turn(sensor.curve.tangents)
    first, last = (t / np.linalg.norm(t) for t in (tangents[0], tangents[-1]))
    exits = [
        surface_queries.find_exit(path[0], -first, body, 2 * diameter),
        surface_queries.find_exit(path[-1], last, body, 2 * diameter),
    ]
    (start, before), (end, after) = exits
    line = np.concatenate([path[:1] - before * first, path, path[-1:] + after * last])
    low, high = before - start, float(arc_lengths(line)[-1]) - (after - end)
    inside = resample(line, low, high, max(3, int((high - low) / SAMPLE_STEP_MM) + 1))
    return _Trace(line, inside, (start, end), (before, after))


def _check_path(sensor: Sensor, path: Float, body: Surface, diameter: float, noun: str) -> None:
    """Raise FabricationError if a path leaves the body or bends too tightly."""
    if (np.linalg.norm(sensor.curve.tangents[[0, -1]], axis=1) < 1e-9).any():
        raise FabricationError(
            "a tangent at its ends is zero",
            code="zero-tangent",
            where=f"{noun} {sensor.name!r}",
            action="Give it a tangent",
            cord=sensor.name,
        )
    inside = signed_distance_of(body).inside(path)
    if not inside[1:-1].all():
        outside = path[1:-1][~inside[1:-1]]
        problem = "misses the body" if not inside.any() else "leaves the body"
        middle = outside[len(outside) // 2]
        raise FabricationError(
            f"{problem} near {format_point(middle)}",
            code="path-leaves-body",
            where=f"{noun} {sensor.name!r}",
            action="Move its plane or its path",
            cord=sensor.name,
            misses=not inside.any(),
            at=middle.tolist(),
        )
    radius = bend_radius(path)
    k = int(radius.argmin())
    if radius[k] < 0.6 * diameter:
        at = format_point(path[k + 1])
        raise FabricationError(
            f"bends to a radius of {radius[k]:.2f} mm near {at}, too tight for a channel of"
            f" {diameter:.2f} mm",
            code="bend-too-tight",
            where=f"{noun} {sensor.name!r}",
            action="Smooth the path",
            cord=sensor.name,
            radius=float(radius[k]),
            at=path[k + 1].tolist(),
        )
