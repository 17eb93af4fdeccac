"""What a mould needs besides its cavity: keys that align its pieces, holes for screws, one to pour
through, and vents for the air."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float
from ...core.errors import FabricationError
from ..kernels.cutting_tools import frame
from ..parts.part_contacts import inside
from .planar import farthest, flat, spots, upright

#: A key's radius at its foot and its height, mm; a screw's hole in the upper piece, its pilot hole
#: in the lower one, and how deep that is: M3, driven into plastic. In a high piece the head goes
#: down a wider hole to a seat so far over the plane, so that all screws are of one length.
_KEY, _KEY_HEIGHT = 2.2, 3.0
_SCREW, _PILOT, _SCREW_DEPTH = 3.4, 2.5, 7.0
_HEAD, _SEAT = 6.6, 5.0
_APART, _WALL = 9.0, 1.4
#: Radii of the hole that is poured through, mm, the first that there is room for, and of vents.
_POURS, _VENT, _VENTS = (3.5, 2.5, 1.8, 1.2), 0.75, 4
_FUNNEL = 2.0  # mm, by which the pouring hole widens at its top


@dataclass(frozen=True)
class Joint:
    """Two pieces with the keys and holes in their common plane, and how many there are of each."""

    above: Any
    below: Any
    keys: int
    screws: int


def joined(
    above: Any, below: Any, cast: Any, normal: Float, origin: Float, opens: Float, play: float
) -> Joint:
    """Keys and screws between two pieces that meet in a plane, the one above coming off along
    `opens` (3,), where there is room for them beside what is `cast`."""
    axes = frame(normal)
    high, low = flat(above, axes, origin), flat(below, axes, origin)
    inner = flat(cast, axes, origin)
    top = high.bounding_box()[5]
    common = low.slice(-0.05) ^ high.slice(0.05)
    for depth in (1.0, _KEY_HEIGHT, _SCREW_DEPTH):
        common = common ^ low.slice(-depth)
    # Over a key at least a layer or two, over a screw nothing.
    for height in (1.5, _KEY_HEIGHT, min(4.9, 0.98 * top)):
        common = common ^ high.slice(height)
    places = spots(common, _KEY + _WALL)
    found = farthest(places, 8, _APART, np.zeros((0, 2)))
    local = axes.T @ opens
    # Keys and screws in turn; a key's place is nobody else's twin, so that pieces fit one way.
    keys = found[0::2]
    add, cut_high, cut_low = [], [], []
    for k, (x, y) in enumerate(keys):
        foot = _KEY - (0.5 if k == 0 else 0.0)
        add.append(_cone(foot, _KEY_HEIGHT, x, y, local, 0.0))
        cut_high.append(_cone(foot, _KEY_HEIGHT, x, y, local, play))
    blocked = _blocked(inner, top)
    screws = found[1::2][~inside(found[1::2], blocked)]
    fewer, known = len(found[1::2]) - len(screws), np.concatenate([keys, screws])
    others = farthest(places[~inside(places, blocked)], fewer, _APART, known)
    screws = np.concatenate([screws, others])
    for x, y in screws:
        cut_high.append(_hole(top, x, y))
        cut_low.append(_rod(_PILOT / 2, -_SCREW_DEPTH, 0.5, x, y))
    if add:
        low = low + m3.Manifold.batch_boolean(add, m3.OpType.Add)
    if cut_low:
        low = low - m3.Manifold.batch_boolean(cut_low, m3.OpType.Add)
    if cut_high:
        high = high - m3.Manifold.batch_boolean(cut_high, m3.OpType.Add)
    return Joint(upright(high, axes, origin), upright(low, axes, origin), len(keys), len(screws))


def _cone(foot: float, height: float, x: float, y: float, opens: Float, play: float) -> Any:
    """A key along the direction in which its piece comes off, wider and higher by the play."""
    cone = m3.Manifold.cylinder(height + 0.5 + play, foot + 0.2 + play, 0.55 * foot + play, 32)
    lean = np.eye(3, 4)
    lean[:2, 2] = opens[:2] / opens[2] if abs(opens[2]) > 0.3 else 0.0
    return cone.translate([0, 0, -0.5]).transform(lean).translate([x, y, 0])


def _blocked(cast: Any, top: float) -> list[Float]:
    """Outlines of the places where a screw would leave too little wall to what is cast."""
    over, under = ([0, 0, 1], [0, 0, -1])
    pilot = cast.trim_by_plane(over, -_SCREW_DEPTH - _WALL).trim_by_plane(under, 0.0)
    hole = cast.trim_by_plane(over, 0.0)
    head = cast.trim_by_plane(over, _SEAT - _WALL if top > _SEAT + 1 else top)
    near = m3.CrossSection()
    for solid, width in ((pilot, _PILOT), (hole, _SCREW), (head, _HEAD)):
        near = near + solid.project().offset(width / 2 + _WALL)
    return [np.asarray(p, float) for p in near.to_polygons()]


def _hole(top: float, x: float, y: float) -> Any:
    """A screw's way through the upper piece, which is `top` mm high."""
    hole = _rod(_SCREW / 2, -0.5, top + 1, x, y)
    return hole + _rod(_HEAD / 2, _SEAT, top + 1, x, y) if top > _SEAT + 1 else hole


def _rod(radius: float, low: float, high: float, x: float, y: float) -> Any:
    return m3.Manifold.cylinder(high - low, radius, radius, 32).translate([x, y, low])


@dataclass(frozen=True)
class Feed:
    """The lid with its holes; where one pours and where air leaves, (3,) and (v, 3) mm."""

    lid: Any
    pour: Float
    vents: Float


def fed(name: str, lid: Any, cavity: Any, normal: Float, origin: Float) -> Feed:
    """The hole to pour through at one end of the face, and vents at its other ends: as the mould
    stands, all of the face is as high as the cavity goes.

    Raises FabricationError where the face has no room for it.
    """
    axes = frame(normal)
    high, inner = flat(lid, axes, origin), flat(cavity, axes, origin)
    face, top = inner.slice(-0.3) ^ inner.slice(-0.05), high.bounding_box()[5]
    for radius in _POURS:
        places = spots(face, radius + 0.8)
        if len(places):
            break
    else:
        raise FabricationError(
            f"{name} cannot be cast: its largest face has no room for a hole of"
            f" {2 * _POURS[-1]:g} mm to pour through; move its cords' planes apart",
            code="no-pouring-hole",
            part=name,
        )
    # At an end: the long way from the middle.
    away = places - places.mean(axis=0)
    long = np.linalg.svd(away - away.mean(axis=0), full_matrices=False)[2][0]
    pour = places[int(np.round(away @ long, 3).argmax())]
    vents = farthest(spots(face, _VENT + 0.5), _VENTS, 3 * radius, pour[None])
    holes = [
        _rod(radius, -0.5, top + 1, *pour),
        m3.Manifold.cylinder(2.5, radius, radius + _FUNNEL, 32).translate([*pour, top - 2]),
        *(_rod(_VENT, -0.5, top + 1, *v) for v in vents),
    ]
    high = high - m3.Manifold.batch_boolean(holes, m3.OpType.Add)

    def world(points: Float) -> Float:
        flat_points = np.column_stack([points, np.zeros(len(points))])
        return np.asarray(origin + flat_points @ axes.T)

    return Feed(upright(high, axes, origin), world(pour[None])[0], world(vents))
