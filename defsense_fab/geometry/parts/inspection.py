"""What finished parts are measured for before anything is written.

Every check returns its measurement; one that fails raises an error that names the cord or part and
the place (mm). The numbers come from the parts' facets and from samples of the channels, not from
the values that the parts were made with.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import igl
import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, xyz
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ..bodies.connector_bay import in_solid, without_bay
from ..channels.channel_ends import INLET_SLOPE, beside
from ..channels.cord_channels import Channel
from ..channels.wire_channels import SLOPE, Hollow
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism, frame
from ..kernels.signed_distance import distances_of
from .alignment_pins import Pin, gap, rings
from .check import Check
from .division import Cut
from .records import Made, Part, Rules

#: Largest relative difference between the body and its parts plus what was removed.
CONSERVATION = 1e-3
#: Of the body's volume, that two parts may overlap: rounding to single precision.
_OVERLAP = 1e-5
#: mm^3 of solid that a cord may touch: rounding of facets.
_TOUCH = 0.02
#: Most of a part that may be thinner than two lines: such places print as gaps. Wedges between
#: planes that cross at small angles are told of long before that.
THIN, TOLD = 0.5, 0.05
_LAYERS = 30
_POINTS = 100_000
_OPENED = (0.3, 2.0, 10.0)  # mm between two halves
_TOLERANCE = 0.02  # mm


def inspect(made: Made, pieces: Sequence[Any], body: Surface, rules: Rules) -> list[Check]:
    """All checks of the parts, whose manifold3d solids are `pieces`, of a `body`."""
    return [
        _volumes(made),
        _apart(made),
        *_sockets(made, body, rules),
        *_features(made, pieces, rules),
        _insertion(made, pieces, rules),
    ]


def _volumes(made: Made) -> Check:
    """Conservation of volume."""
    total = sum(p.volume for p in made.parts) + made.cut_out
    error = abs(total / made.body_volume - 1)
    if not error <= CONSERVATION:
        raise FabricationError(
            f"parts and what was cut out add up to {total:.1f} mm^3 but the body has"
            f" {made.body_volume:.1f}; the cut failed: move a cord plane slightly"
        )
    return Check("volume lost or gained, of the body", error, CONSERVATION, "", "")


def _apart(made: Made) -> Check:
    """No two exported parts overlap."""
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in made.parts]
    worst, at = 0.0, ""
    for i, a in enumerate(solids):
        for j in range(i):
            common = a ^ solids[j]
            volume = float(common.volume())
            if volume > _OVERLAP * made.body_volume:
                volume = min(volume, _common(common, made.parts[i], made.parts[j]))
            if volume > worst:
                worst, at = (
                    volume,
                    xyz(triangle_kernel.centroid(triangle_kernel.to_surface(common))),
                )
            if volume > _OVERLAP * made.body_volume:
                raise FabricationError(
                    f"{made.parts[j].name} and {made.parts[i].name} overlap by {volume:.1f} mm^3"
                    f" near {at}; the cut failed: move a cord plane slightly"
                )
    return Check("overlap of two parts", worst, _OVERLAP * made.body_volume, "mm3", at)


def _common(claimed: Any, a: Part, b: Part) -> float:
    """The volume (mm^3) that two parts have in common where they are said to: the share of points
    there that lie in both. Faces of one cut are rounded apart by 1e-5 mm, and now and then a
    boolean operation makes much of that."""
    bounds = triangle_kernel.to_surface(claimed).bounds
    points = np.random.default_rng(0).uniform(bounds[0], bounds[1], (_POINTS, 3))
    both = np.ones(len(points), bool)
    for s in (a.surface, b.surface):
        both &= np.asarray(igl.fast_winding_number(s.vertices, s.faces, points)) > 0.5
    return float(both.mean() * np.prod(np.ptp(bounds, axis=0)))


def walls(channels: Sequence[Channel], body: Surface, rules: Rules) -> list[Check]:
    """Walls between channels and the skin, and between channels."""
    distances = distances_of(body)
    radius, out = rules.channel / 2, []
    for i, channel in enumerate(channels):
        depth = distances.unsigned(channel.inside)
        along = np.linspace(0, channel.length, len(channel.inside))
        to_mouth = np.minimum(along, along[-1] - along)
        needed = np.minimum(radius + rules.wall, INLET_SLOPE * to_mouth)
        k = int((depth - needed).argmin())
        if depth[k] < needed[k] - _TOLERANCE:
            raise FabricationError(
                f"cord {channel.name!r} leaves a wall of {depth[k] - radius:.2f} mm to the skin"
                f" near {xyz(channel.inside[k])}; {rules.wall:.2f} mm is needed: move it inwards"
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
                    xyz(channel.inside[k]),
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
                    f" {xyz(channel.inside[k])}; {rules.wall:.2f} mm is needed: move them apart"
                )
            at = xyz(channel.inside[k])
            out.append(Check(name, wall, least, "mm", at, at_least=True))
    return out


def wire_walls(channels: Sequence[Channel], body: Surface, rules: Rules) -> list[Check]:
    """Walls between the wires' leads and the skin, all other channels, and their own cord beyond
    the pocket that they begin in."""
    if not rules.pockets or not rules.pockets.wires:
        return []
    wires = rules.pockets.wires
    distances = distances_of(without_bay(body, wires.bay) if wires.bay else body)
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
            wall, at = float(away[k]) - radius, xyz(points[k])
            name = f"wall from the wire of cord {channel.name} to {what}"
            if wall < least - 2 * _TOLERANCE:
                raise FabricationError(
                    f"{name}: {wall:.2f} mm near {at}; {least:.2f} mm is needed: move the cord"
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


def _sockets(made: Made, body: Surface, rules: Rules) -> list[Check]:
    """Walls from sockets to grooves and to the skin, sampled on the sockets' surface."""
    if not made.pins:
        return []
    distances = distances_of(body)
    skin, groove = np.inf, np.inf
    where = ["", "", ""]
    hollows = [
        (c.name, cKDTree(points), radius)
        for c in made.channels
        for points, radius in c.hollows(rules.channel, rules.pockets)
    ]
    apart = np.inf
    for k, pin in enumerate(made.pins):
        hull = _shell(pin)
        between = float(gap(hull, made.pins[:k]).min())
        if between < apart:
            apart, where[2] = between, xyz(pin.center)
        depth = distances.unsigned(hull)
        if depth.min() < skin:
            skin, where[0] = float(depth.min()), xyz(pin.center)
        for name, line, radius in hollows:
            wall = float(line.query(hull)[0].min()) - radius
            if wall < groove:
                groove, where[1] = wall, f"{xyz(pin.center)}, cord {name}"
    least = rules.inner_wall
    used = least - 3 * _TOLERANCE
    out = [
        Check("wall from socket to skin", skin, used, "mm", where[0], at_least=True),
        Check("wall from socket to groove", groove, used, "mm", where[1], at_least=True),
    ]
    if np.isfinite(apart):
        out.append(Check("wall from socket to socket", apart, used, "mm", where[2], at_least=True))
    for check in out:
        if not check.holds:
            raise FabricationError(
                f"{check.name}: {check.value:.2f} mm near {check.at}; {least:.2f} mm is needed"
            )
    return out


def _shell(pin: Pin) -> Float:
    """Points (n, 3) on both sockets of a pin."""
    heights = np.linspace(-pin.depth, pin.depth, 2 * int(np.ceil(pin.depth / 0.5)) + 1)
    last = len(heights) - 1
    local = [rings(pin.socket / 2, h, bottom=k in (0, last)) for k, h in enumerate(heights)]
    return np.asarray(pin.center + np.concatenate(local) @ frame(pin.axis).T)


def _features(made: Made, pieces: Sequence[Any], rules: Rules) -> list[Check]:
    """How much of each part is thinner than two lines of the printer, in the layers in which it is
    printed: what is lost when their outlines are opened by that width."""
    width, out = rules.inner_wall, []
    for i, (part, piece) in enumerate(zip(made.parts, pieces, strict=True)):
        axes = frame(-part.down)
        lying = piece.transform(np.column_stack([axes.T, np.zeros(3)]))
        low, high = lying.bounding_box()[2], lying.bounding_box()[5]
        whole, thin, at, most = 0.0, 0.0, part.center, 0.0
        for z in low + (np.arange(_LAYERS) + 0.5) / _LAYERS * (high - low):
            layer = lying.slice(z)
            whole += float(layer.area())
            lost = layer - layer.offset(-width / 2).offset(width / 2 + 0.01)
            for shape in lost.decompose():
                area = float(shape.area())
                if area > width**2:  # not just a corner
                    thin += area
                    if area > most:
                        most = area
                        x = np.asarray(shape.to_polygons()[0]).mean(axis=0)
                        at = axes @ np.array([*x, z])
        share = thin / whole if whole else 1.0
        if share > THIN:
            near = {c for cut in made.cuts for c in cut.cords if any(i in s for s in cut.sides)}
            cords = " and ".join(repr(made.channels[c].name) for c in sorted(near))
            raise FabricationError(
                f"{part.name} is thinner than {width:.1f} mm in {share:.0%} of it, near"
                f" {xyz(at)}, between the planes of {cords}"
                " and the skin: move a plane"
            )
        name = f"{part.name}: share thinner than {width:.1f} mm"
        told = f"{name}: {share:.0%}, near {xyz(at)}: it may print with gaps"
        out.append(
            Check(name, share, THIN, "", xyz(at) if thin else "", told if share > TOLD else "")
        )
    return out


def _insertion(made: Made, pieces: Sequence[Any], rules: Rules) -> Check:
    """Whether every cord with its wires lies in its groove and can be laid in: closed it touches no
    part; with the two sides of a cut apart, those of the cut touch neither."""
    worst = 0.0
    wire = rules.pockets.wires.wire if rules.pockets and rules.pockets.wires else 0.0
    cords = [triangle_kernel.union([c.cord(rules.cord), *c.wires(wire)]) for c in made.channels]
    for channel, cord in zip(made.channels, cords, strict=True):
        for piece in pieces:
            worst = max(worst, _touch(cord, piece, f"cord {channel.name!r} in its closed groove"))
    for cut in made.cuts:
        for c in cut.cords:
            what = f"cord {made.channels[c].name!r} as its groove is closed"
            for side, way in zip(cut.sides, (-cut.plane.normal, cut.plane.normal), strict=True):
                for i, lift in itertools.product(side, _OPENED):
                    worst = max(worst, _touch(cords[c], pieces[i].translate(lift * way), what))
    return Check("cord in solid, closed and opened", worst, _TOUCH, "mm3", "")


def _touch(cord: Any, piece: Any, what: str) -> float:
    common = cord ^ piece
    volume = float(common.volume())
    if volume > _TOUCH:
        at = triangle_kernel.centroid(triangle_kernel.to_surface(common))
        raise FabricationError(
            f"{what} meets {volume:.2f} mm^3 of solid near {xyz(at)}; move the cord or its plane"
        )
    return volume


def cut_name(cut: Cut, channels: Sequence[Channel]) -> str:
    """The cords that a cut is for."""
    return " and ".join(repr(channels[c].name) for c in cut.cords)
