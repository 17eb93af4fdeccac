"""Walls around the channels of cords and wires."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, format_point
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..bodies.connector_bay import in_solid, without_bay
from ..channels.channel_ends import MAX_INLET_SLOPE, beside
from ..channels.cord_channels import Channel
from ..channels.wire_channels import SLOPE, Hollow
from ..kernels.cutting_tools import Prism, frame
from ..kernels.surface_queries import signed_distance_of
from .alignment_pins import Pin, gap, rings
from .records import Check, PartSet, PartRules

# Walls around the sockets of pins.

#: Walls around sockets may be thinner than asked by this: facets and samples, mm.
TOLERANCE = 0.06


def sockets(made: PartSet, body: Surface, rules: PartRules) -> list[Check]:
    """Walls from sockets to grooves and to the skin, sampled on the sockets' surface.
    Raises FabricationError for one that is too thin."""
    if not made.pins:
        return []
    distances = signed_distance_of(body)
    skin, groove = np.inf, np.inf
    where = ["", "", ""]
    hollows = [
        (c.name, cKDTree(points), radius)
        for c in made.channels
        for points, radius in c.hollows(rules.channel, rules.pockets)
    ]
    apart = np.inf
    for k, pin in enumerate(made.pins):
        hull = shell(pin)
        between = float(gap(hull, made.pins[:k]).min())
        if between < apart:
            apart, where[2] = between, format_point(pin.center)
        depth = distances.unsigned(hull)
        if depth.min() < skin:
            skin, where[0] = float(depth.min()), format_point(pin.center)
        for name, line, radius in hollows:
            wall = float(line.query(hull)[0].min()) - radius
            if wall < groove:
                groove, where[1] = wall, f"{format_point(pin.center)}, cord {name}"
    least = rules.inner_wall
    used = least - TOLERANCE
    out = [
        Check("wall from socket to skin", skin, used, "mm", where[0], at_least=True),
        Check("wall from socket to groove", groove, used, "mm", where[1], at_least=True),
    ]
    if np.isfinite(apart):
        out.append(Check("wall from socket to socket", apart, used, "mm", where[2], at_least=True))
    for check in out:
        if not check.holds:
            raise FabricationError(
                f"{check.name}: {check.value:.2f} mm near {check.at}; {least:.2f} mm is needed",
                code="wall-too-thin",
                wall=check.value,
            )
    return out


def shell(pin: Pin) -> Float:
    """Points (n, 3) on both sockets of a pin."""
    heights = np.linspace(-pin.depth, pin.depth, 2 * int(np.ceil(pin.depth / 0.5)) + 1)
    last = len(heights) - 1
    local = [rings(pin.socket / 2, h, bottom=k in (0, last)) for k, h in enumerate(heights)]
    return np.asarray(pin.center + np.concatenate(local) @ frame(pin.axis).T)


_TOLERANCE = 0.02  # mm


def walls(channels: Sequence[Channel], body: Surface, rules: PartRules) -> list[Check]:
    """Walls between channels and the skin, and between channels."""
    distances = signed_distance_of(body)
    radius, out = rules.channel / 2, []
    for i, channel in enumerate(channels):
        depth = distances.unsigned(channel.inside)
        along = np.linspace(0, channel.length, len(channel.inside))
        to_mouth = np.minimum(along, along[-1] - along)
        needed = np.minimum(radius + rules.wall, MAX_INLET_SLOPE * to_mouth)
        k = int((depth - needed).argmin())
        if depth[k] < needed[k] - _TOLERANCE:
            raise FabricationError(
                f"cord {channel.name!r} leaves a wall of {depth[k] - radius:.2f} mm to the skin"
                f" near {format_point(channel.inside[k])}; {rules.wall:.2f} mm is needed: move it inwards",
                code="wall-too-thin",
                cord=channel.name,
                wall=float(depth[k]) - radius,
            )
        whole = np.where(needed >= radius + rules.wall - 1e-9, depth, np.inf)
        k = int(whole.argmin())
        if np.isfinite(whole[k]):
            out.append(
                Check(
                    f"wall from cord {channel.name} to the skin",
                    float(whole[k]) - radius,
                    rules.wall - _TOLERANCE,
                    "mm",
                    format_point(channel.inside[k]),
                    at_least=True,
                )
            )
        for other in channels[i + 1 :]:
            away, _ = cKDTree(other.inside).query(channel.inside)
            k = int(away.argmin())
            wall = float(away[k]) - 2 * radius
            name = f"wall from cord {channel.name} to cord {other.name}"
            least = rules.wall - 2 * _TOLERANCE
            if wall < least:
                raise FabricationError(
                    f"cords {channel.name!r} and {other.name!r} leave a wall of {wall:.2f} mm near"
                    f" {format_point(channel.inside[k])}; {rules.wall:.2f} mm is needed: move them apart",
                    code="wall-too-thin",
                    cords=(channel.name, other.name),
                    wall=wall,
                )
            at = format_point(channel.inside[k])
            out.append(Check(name, wall, least, "mm", at, at_least=True))
    return out


def wire_walls(channels: Sequence[Channel], body: Surface, rules: PartRules) -> list[Check]:
    """Walls between the wires' leads and the skin, all other channels, and their own cord beyond
    the pocket that they begin in."""
    if not rules.pockets or not rules.pockets.wires:
        return []
    wires = rules.pockets.wires
    distances = signed_distance_of(without_bay(body, wires.bay) if wires.bay else body)
    radius, least = wires.diameter / 2, rules.inner_wall
    thinnest: dict[str, Check] = {}
    for channel, end, line, twin in (
        (c, c.ends[k], c.inside if k == 0 else c.inside[::-1], c.ends[1 - k])
        for c in channels
        for k in (0, 1)
    ):
        if end.lead is None:
            continue
        points = in_solid(end.lead.whole, wires.bay)
        near = np.linalg.norm(points - end.lead.exit, axis=1) <= (radius + least) / SLOPE
        away = distances.unsigned(points)
        to_skin = np.where(near & (not end.lead.to_bay), np.inf, away)
        found = [("the skin", to_skin)]
        hollows = beside(line, twin, end.pocket, rules.channel, rules.pockets)
        found += [("its cord", _away(points, h, wires.bay)) for h in hollows]
        for other in channels:
            if other is not channel:
                hollows = other.hollows(rules.channel, rules.pockets)
                what = f"cord {other.name}"
                found += [(what, _away(points, h, wires.bay)) for h in hollows]
        for what, away in found:
            k = int(away.argmin())
            wall, at = float(away[k]) - radius, format_point(points[k])
            name = f"wall from the wire of cord {channel.name} to {what}"
            if wall < least - 2 * _TOLERANCE:
                raise FabricationError(
                    f"{name}: {wall:.2f} mm near {at}; {least:.2f} mm is needed: move the cord",
                    code="wall-too-thin",
                    cord=channel.name,
                    wall=wall,
                )
            if np.isfinite(wall) and (name not in thinnest or wall < thinnest[name].value):
                used = least - 2 * _TOLERANCE
                thinnest[name] = Check(name, wall, used, "mm", at, at_least=True)
    return list(thinnest.values())


def _away(points: Float, hollow: Hollow, bay: Prism | None) -> Float:
    """Distances (n,) mm of points (n, 3) from what is hollow in the solid."""
    solid = in_solid(hollow[0], bay)
    if not len(solid):
        return np.full(len(points), np.inf)
    return np.asarray(cKDTree(solid).query(points)[0] - hollow[1])
