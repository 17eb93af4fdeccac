"""The cords' channels from skin to skin, with their ends."""

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
from .channel_ends import End, Ends, Pockets, end_tools
from .wire_channels import Hollow, Lead

_STEP = 0.25  # mm, between samples of a channel
_SAG = 0.004  # mm, between a channel's chords and the path


@dataclass(frozen=True)
class Channel:
    """A cord's channel. `line` (p, 3) mm is its centre line with the tool's runs out of the body,
    `inside` (q, 3) the part of it from mouth to mouth; `inlets` are the straight runs from the
    path's ends to the skin and `runs` how far the tool goes on from the path's ends, mm; `tools`
    shape its `ends`; `solid` is all of it for manifold3d, with the wires' leads."""

    sensor: Sensor
    line: Float
    inside: Float
    inlets: tuple[float, float]
    runs: tuple[float, float]
    ends: tuple[End, End]
    tools: tuple[Tool, ...]
    solid: Any

    @property
    def name(self) -> str:
        return self.sensor.name

    @property
    def length(self) -> float:
        """From mouth to mouth, mm."""
        return float(np.linalg.norm(np.diff(self.inside, axis=0), axis=1).sum())

    @property
    def between(self) -> float:
        """What of that is not in pockets, mm: the least that a cord has between its ferrules."""
        return self.length - sum(e.pocket for e in self.ends)

    @property
    def sensing(self) -> Float:
        """The stretch of the cord's path (p, 3) mm outside of its pockets, p as in `sample_path`:
        what lies in a pocket, and straight runs to the skin, are not strained."""
        path = sample_path(self.sensor)
        hidden = [max(0.0, e.pocket - i) for e, i in zip(self.ends, self.inlets, strict=True)]
        return resample(path, hidden[0], float(arc_lengths(path)[-1]) - hidden[1], len(path))

    def hollows(self, diameter: float, pockets: Pockets | None) -> list[Hollow]:
        """Points (n, 3) mm along what is hollow, and its radius there, mm."""
        out = [(self.inside, diameter / 2)]
        for end in self.ends:
            out += end.hollows(pockets)
        return out

    @property
    def leads(self) -> list[Lead]:
        """Those that there are."""
        return [end.lead for end in self.ends if end.lead]

    @property
    def insides(self) -> list[Float]:
        """Centre lines of the channel and its leads in the body, each (p, 3) mm."""
        return [self.inside, *(lead.inside for lead in self.leads)]

    @property
    def lines(self) -> list[Float]:
        """Centre lines of the channel and its leads with the tools' runs, each (p, 3) mm."""
        return [self.line, *(lead.line for lead in self.leads)]

    def cord(self, diameter: float) -> Any:
        """A solid of the cord itself, along the path and its straight runs out of the body; finer
        than the channel that it is checked in."""
        path = sample_path(self.sensor, 2 * per_span_for_sag(self.sensor.curve, _SAG))
        line = np.concatenate([self.line[:1], path, self.line[-1:]])
        return triangle_kernel.tube(line, self.sensor.plane.normal, diameter, sides=24)

    def wires(self, diameter: float) -> list[Any]:
        """Solids of the wires in their leads."""
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
    """Every cord's channel of `diameter` mm. Raises FabricationError for a path that is not in
    the body, or bends too tightly for a channel."""
    traced = [_trace(s, body, diameter) for s in sensors]
    planes = [s.plane for s in sensors]
    ends = Ends(planes, [t.inside for t in traced], diameter, wall, body, pockets).made()
    out = []
    for s, t, pair in zip(sensors, traced, ends, strict=True):
        tools = tuple(tool for e in pair for tool in end_tools(e, diameter, wall, pockets))
        tubes = [triangle_kernel.tube(t.line, s.plane.normal, diameter)]
        if pockets and pockets.wires:
            wide = pockets.wires.diameter
            tubes += [
                triangle_kernel.tube(e.lead.line, s.plane.normal, wide) for e in pair if e.lead
            ]
        solid = triangle_kernel.union([*tubes, *(triangle_kernel.solid_of(tool) for tool in tools)])
        out.append(Channel(s, t.line, t.inside, t.inlets, t.runs, pair, tools, solid))
    return out


@dataclass(frozen=True)
class _Trace:
    line: Float
    inside: Float
    inlets: tuple[float, float]
    runs: tuple[float, float]


def _trace(sensor: Sensor, body: Surface, diameter: float) -> _Trace:
    path = sample_path(sensor, per_span_for_sag(sensor.curve, _SAG))
    _check_path(sensor, path, body, diameter)
    tangents = sensor.curve.tangents @ sensor.plane.axes[:, :2].T
    first, last = (t / np.linalg.norm(t) for t in (tangents[0], tangents[-1]))
    found = [
        surface_queries.find_exit(path[0], -first, body, 2 * diameter),
        surface_queries.find_exit(path[-1], last, body, 2 * diameter),
    ]
    (start, before), (end, after) = found
    line = np.concatenate([path[:1] - before * first, path, path[-1:] + after * last])
    low, high = before - start, float(arc_lengths(line)[-1]) - (after - end)
    inside = resample(line, low, high, max(3, int((high - low) / _STEP) + 1))
    return _Trace(line, inside, (start, end), (before, after))


def _check_path(sensor: Sensor, path: Float, body: Surface, diameter: float) -> None:
    if (np.linalg.norm(sensor.curve.tangents[[0, -1]], axis=1) < 1e-9).any():
        raise FabricationError(
            f"cord {sensor.name!r}: a tangent at its ends is zero; give it one",
            code="zero-tangent",
            cord=sensor.name,
        )
    inside = signed_distance_of(body).inside(path)
    if not inside[1:-1].all():
        outside = path[1:-1][~inside[1:-1]]
        where = "misses the body" if not inside.any() else "leaves the body"
        at = format_point(outside[len(outside) // 2])
        raise FabricationError(
            f"cord {sensor.name!r} {where} near {at}; move its plane or its path",
            code="path-leaves-body",
            cord=sensor.name,
            misses=not inside.any(),
        )
    radius = bend_radius(path)
    k = int(radius.argmin())
    if radius[k] < 0.6 * diameter:
        at = format_point(path[k + 1])
        raise FabricationError(
            f"cord {sensor.name!r} bends to a radius of {radius[k]:.2f} mm near {at}, too tight"
            f" for a channel of {diameter:.2f} mm; smooth the path",
            code="bend-too-tight",
            cord=sensor.name,
            radius=float(radius[k]),
        )
