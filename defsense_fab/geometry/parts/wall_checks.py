"""Check walls around the channels of cords and wires, and around the sockets of pins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, format_point
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..bodies.connector_bay import outside_bay, without_bay
from ..channels.channel_ends import MAX_INLET_SLOPE, own_hollows
from ..channels.cord_channels import Channel
from ..channels.wire_channels import MAX_EXIT_SLOPE, Hollow
from ..kernels.cutting_tools import Prism, axes_from_normal
from ..kernels.surface_queries import signed_distance_of
from .alignment_pins import Pin, distance_to_sockets, socket_rings
from .records import Check, PartRules, PartSet

#: Allowance for facets and samples in walls around sockets.
SOCKET_TOLERANCE_MM = 0.06


def check_sockets(part_set: PartSet, body: Surface, rules: PartRules) -> list[Check]:
    """Check walls from sockets to grooves, to the skin and to each other, sampled on the sockets.

    Args:
        part_set: The parts.
        body: Surface of the body.
        rules: Rules of the parts.

    Raises:
        FabricationError: If a wall is too thin.
    """
    if not part_set.pins:
        return []
    distances = signed_distance_of(body)
    skin, groove = np.inf, np.inf
    where = ["", "", ""]
    hollows = [
        (c.name, cKDTree(points), radius)
        for c in part_set.channels
        for points, radius in c.hollows(rules.channel, rules.pockets)
    ]
    between_sockets = np.inf
    for k, pin in enumerate(part_set.pins):
        points_on_pin = socket_points(pin)
        between = float(distance_to_sockets(points_on_pin, part_set.pins[:k]).min())
        if between < between_sockets:
            between_sockets, where[2] = between, format_point(pin.center)
        depth = distances.unsigned(points_on_pin)
        if depth.min() < skin:
            skin, where[0] = float(depth.min()), format_point(pin.center)
        for name, line, radius in hollows:
            wall = float(line.query(points_on_pin)[0].min()) - radius
            if wall < groove:
                groove, where[1] = wall, f"{format_point(pin.center)}, cord {name}"
    required = rules.inner_wall
    limit = required - SOCKET_TOLERANCE_MM
    checks = [
        Check("wall from socket to skin", skin, limit, "mm", where[0], at_least=True),
        Check("wall from socket to groove", groove, limit, "mm", where[1], at_least=True),
    ]
    if np.isfinite(between_sockets):
        checks.append(
            Check(
                "wall from socket to socket", between_sockets, limit, "mm", where[2], at_least=True
            )
        )
    return [check.require(required, "wall-too-thin", wall=check.value) for check in checks]


def socket_points(pin: Pin) -> Float:
    """Return points (n, 3) on both sockets of a pin, mm."""
    heights = np.linspace(-pin.depth, pin.depth, 2 * int(np.ceil(pin.depth / 0.5)) + 1)
    last = len(heights) - 1
    local = [socket_rings(pin.socket / 2, h, bottom=k in (0, last)) for k, h in enumerate(heights)]
    return np.asarray(pin.center + np.concatenate(local) @ axes_from_normal(pin.axis).T)


CHANNEL_TOLERANCE_MM = 0.02


def check_cord_walls(channels: Sequence[Channel], body: Surface, rules: PartRules) -> list[Check]:
    """Check walls between channels and the skin, and between channels.

    Raises:
        FabricationError: If a wall is too thin.
    """
    distances = signed_distance_of(body)
    radius, checks = rules.channel / 2, []
    for i, channel in enumerate(channels):
        depth = distances.unsigned(channel.inside)
        along = np.linspace(0, channel.length, len(channel.inside))
        to_mouth = np.minimum(along, along[-1] - along)
        needed = np.minimum(radius + rules.wall, MAX_INLET_SLOPE * to_mouth)
        k = int((depth - needed).argmin())
        if depth[k] < needed[k] - CHANNEL_TOLERANCE_MM:
            raise FabricationError(
                f"leaves a wall of {depth[k] - radius:.2f} mm to the skin near"
                f" {format_point(channel.inside[k])}, and {rules.wall:.2f} mm is needed",
                code="wall-too-thin",
                where=f"{channel.noun} {channel.name!r}",
                action="Move it inwards",
                cord=channel.name,
                wall=float(depth[k]) - radius,
                at=channel.inside[k].tolist(),
            )
        full_depth = np.where(needed >= radius + rules.wall - 1e-9, depth, np.inf)
        k = int(full_depth.argmin())
        if np.isfinite(full_depth[k]):
            checks.append(
                Check(
                    f"wall from {channel.noun} {channel.name} to the skin",
                    float(full_depth[k]) - radius,
                    rules.wall - CHANNEL_TOLERANCE_MM,
                    "mm",
                    format_point(channel.inside[k]),
                    at_least=True,
                )
            )
        for other in channels[i + 1 :]:
            distance, _ = cKDTree(other.inside).query(channel.inside)
            k = int(distance.argmin())
            wall = float(distance[k]) - 2 * radius
            name = f"wall from {channel.noun} {channel.name} to {other.noun} {other.name}"
            limit = rules.wall - 2 * CHANNEL_TOLERANCE_MM
            if wall < limit:
                raise FabricationError(
                    f"leave a wall of {wall:.2f} mm near {format_point(channel.inside[k])}, and"
                    f" {rules.wall:.2f} mm is needed",
                    code="wall-too-thin",
                    where=f"{channel.noun}s {channel.name!r} and {other.name!r}",
                    action="Move them apart",
                    cords=(channel.name, other.name),
                    wall=wall,
                    at=channel.inside[k].tolist(),
                )
            at = format_point(channel.inside[k])
            checks.append(Check(name, wall, limit, "mm", at, at_least=True))
    return checks


def check_wire_walls(channels: Sequence[Channel], body: Surface, rules: PartRules) -> list[Check]:
    """Check walls between the wires' leads and the skin, all other channels, and their own cord
    beyond the pocket in which they start.

    Raises:
        FabricationError: If a wall is too thin.
    """
    if not rules.pockets or not rules.pockets.wires:
        return []
    wires = rules.pockets.wires
    distances = signed_distance_of(without_bay(body, wires.bay) if wires.bay else body)
    radius, required = wires.diameter / 2, rules.inner_wall
    thinnest: dict[str, Check] = {}
    for channel, end, line, twin in (
        (c, c.ends[k], c.inside if k == 0 else c.inside[::-1], c.ends[1 - k])
        for c in channels
        for k in (0, 1)
    ):
        if end.lead is None:
            continue
        points = outside_bay(end.lead.whole, wires.bay)
        is_near_exit = (
            np.linalg.norm(points - end.lead.exit, axis=1) <= (radius + required) / MAX_EXIT_SLOPE
        )
        distance = distances.unsigned(points)
        to_skin = np.where(is_near_exit & (not end.lead.to_bay), np.inf, distance)
        gaps = [("the skin", to_skin)]
        hollows = own_hollows(line, twin, end.pocket, rules.channel, rules.pockets)
        gaps += [("its cord", _distance_to(points, h, wires.bay)) for h in hollows]
        for other in channels:
            if other is not channel:
                hollows = other.hollows(rules.channel, rules.pockets)
                what = f"cord {other.name}"
                gaps += [(what, _distance_to(points, h, wires.bay)) for h in hollows]
        for what, distance in gaps:
            k = int(distance.argmin())
            wall, at = float(distance[k]) - radius, format_point(points[k])
            name = f"wall from the wire of cord {channel.name} to {what}"
            limit = required - 2 * CHANNEL_TOLERANCE_MM
            check = Check(name, wall, limit, "mm", at, at_least=True)
            facts = {"cord": channel.name, "wall": wall, "at": points[k].tolist()}
            check.require(required, "wall-too-thin", "Move the cord", **facts)
            if np.isfinite(wall) and (name not in thinnest or wall < thinnest[name].value):
                thinnest[name] = check
    return list(thinnest.values())


def _distance_to(points: Float, hollow: Hollow, bay: Prism | None) -> Float:
    """Return the distance (n,) of points (n, 3) from a hollow in the solid, mm."""
    solid = outside_bay(hollow[0], bay)
    if not len(solid):
        return np.full(len(points), np.inf)
    return np.asarray(cKDTree(solid).query(points)[0] - hollow[1])
