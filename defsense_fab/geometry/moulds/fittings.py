"""Add fittings to a mould: keys that align its pieces, screw holes, a pouring hole and vents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float
from ...core.errors import FabricationError
from ..kernels.cutting_tools import axes_from_normal
from ..kernels.surface_queries import distance_to_chosen, inside_outlines
from ..kernels.triangle_kernel import from_plane_frame, to_plane_frame, union

#: Radius at the foot and height of a key; diameters of a screw's hole in the upper piece and of its
#: pilot hole in the lower one, and the depth of that: M3, driven into plastic. In a high piece the
#: head goes down a wider hole to a seat over the plane, so that all screws have one length.
KEY_RADIUS_MM, KEY_HEIGHT_MM = 2.2, 3.0
SCREW_HOLE_MM, PILOT_HOLE_MM, PILOT_DEPTH_MM = 3.4, 2.5, 7.0
HEAD_HOLE_MM, HEAD_SEAT_MM = 6.6, 5.0
FITTING_DISTANCE_MM, FITTING_WALL_MM = 9.0, 1.4
#: Radii of the pouring hole, the first that has room, and of vents.
POUR_RADII_MM, VENT_RADIUS_MM, MAX_VENTS = (3.5, 2.5, 1.8, 1.2), 0.75, 4
MAX_SPOTS = 400  # candidate places for a fitting
FUNNEL_WIDENING_MM = 2.0  # of the pouring hole at its top


@dataclass(frozen=True)
class Joint:
    """Two pieces with the keys and holes in their common plane.

    Attributes:
        above: The piece above.
        below: The piece below.
        keys: Number of keys.
        screws: Number of screws.
    """

    above: Any
    below: Any
    keys: int
    screws: int


def join_pieces(
    above: Any, below: Any, cast: Any, normal: Float, origin: Float, opens: Float, play: float
) -> Joint:
    """Add keys and screws between two pieces, where there is room next to the cast.

    Args:
        above: The piece above the plane.
        below: The piece below.
        cast: The cast part.
        normal: Unit normal (3,) of the plane.
        origin: Point (3,) of the plane, mm.
        opens: Direction (3,) in which the piece above comes off.
        play: Play of keys, mm.
    """
    axes = axes_from_normal(normal)
    high, low = to_plane_frame(above, axes, origin), to_plane_frame(below, axes, origin)
    inner = to_plane_frame(cast, axes, origin)
    top = high.bounding_box()[5]
    common = low.slice(-0.05) ^ high.slice(0.05)
    for depth in (1.0, KEY_HEIGHT_MM, PILOT_DEPTH_MM):
        common = common ^ low.slice(-depth)
    # Over a key at least a layer or two remain, over a screw nothing.
    for height in (1.5, KEY_HEIGHT_MM, min(4.9, 0.98 * top)):
        common = common ^ high.slice(height)
    places = _find_spots(common, KEY_RADIUS_MM + FITTING_WALL_MM)
    chosen = _spread_points(places, 8, FITTING_DISTANCE_MM, np.zeros((0, 2)))
    local = axes.T @ opens
    # Keys and screws alternate; no two keys are alike, so that pieces fit in one way.
    keys = chosen[0::2]
    add, cut_high, cut_low = [], [], []
    for k, (x, y) in enumerate(keys):
        foot = KEY_RADIUS_MM - (0.5 if k == 0 else 0.0)
        add.append(_make_key(foot, KEY_HEIGHT_MM, x, y, local, 0.0))
        cut_high.append(_make_key(foot, KEY_HEIGHT_MM, x, y, local, play))
    blocked_outlines = _find_blocked(inner, top)
    screws = chosen[1::2][~inside_outlines(chosen[1::2], blocked_outlines)]
    missing, occupied = len(chosen[1::2]) - len(screws), np.concatenate([keys, screws])
    more_screws = _spread_points(
        places[~inside_outlines(places, blocked_outlines)], missing, FITTING_DISTANCE_MM, occupied
    )
    screws = np.concatenate([screws, more_screws])
    for x, y in screws:
        cut_high.append(_screw_hole(top, x, y))
        cut_low.append(_rod(PILOT_HOLE_MM / 2, -PILOT_DEPTH_MM, 0.5, x, y))
    if add:
        low = low + union(add)
    if cut_low:
        low = low - union(cut_low)
    if cut_high:
        high = high - union(cut_high)
    return Joint(
        from_plane_frame(high, axes, origin),
        from_plane_frame(low, axes, origin),
        len(keys),
        len(screws),
    )


def _make_key(foot: float, height: float, x: float, y: float, opens: Float, play: float) -> Any:
    """Return a key along the direction in which its piece comes off, enlarged by the play."""
    cone = m3.Manifold.cylinder(height + 0.5 + play, foot + 0.2 + play, 0.55 * foot + play, 32)
    lean = np.eye(3, 4)
    lean[:2, 2] = opens[:2] / opens[2] if abs(opens[2]) > 0.3 else 0.0
    return cone.translate([0, 0, -0.5]).transform(lean).translate([x, y, 0])


def _find_blocked(cast: Any, top: float) -> list[Float]:
    """Return outlines of the places where a screw would leave too little wall to the cast."""
    over, under = ([0, 0, 1], [0, 0, -1])
    pilot = cast.trim_by_plane(over, -PILOT_DEPTH_MM - FITTING_WALL_MM).trim_by_plane(under, 0.0)
    hole = cast.trim_by_plane(over, 0.0)
    head = cast.trim_by_plane(
        over, HEAD_SEAT_MM - FITTING_WALL_MM if top > HEAD_SEAT_MM + 1 else top
    )
    area = m3.CrossSection()
    for solid, width in ((pilot, PILOT_HOLE_MM), (hole, SCREW_HOLE_MM), (head, HEAD_HOLE_MM)):
        area = area + solid.project().offset(width / 2 + FITTING_WALL_MM)
    return [np.asarray(p, float) for p in area.to_polygons()]


def _screw_hole(top: float, x: float, y: float) -> Any:
    """Return a screw's hole through the upper piece, which is `top` mm high."""
    hole = _rod(SCREW_HOLE_MM / 2, -0.5, top + 1, x, y)
    return (
        hole + _rod(HEAD_HOLE_MM / 2, HEAD_SEAT_MM, top + 1, x, y)
        if top > HEAD_SEAT_MM + 1
        else hole
    )


def _rod(radius: float, low: float, high: float, x: float, y: float) -> Any:
    return m3.Manifold.cylinder(high - low, radius, radius, 32).translate([x, y, low])


@dataclass(frozen=True)
class Feed:
    """A lid with its holes.

    Attributes:
        lid: The lid.
        pour: Pouring hole (3,), mm.
        vents: Vents (v, 3), mm.
    """

    lid: Any
    pour: Float
    vents: Float


def make_feed(name: str, lid: Any, cavity: Any, normal: Float, origin: Float) -> Feed:
    """Add a pouring hole at one end of a face, and vents at its other ends.

    While the mould stands to be filled, the whole face is as high as the cavity reaches.

    Raises:
        FabricationError: If the face has no room for the hole.
    """
    axes = axes_from_normal(normal)
    high, inner = to_plane_frame(lid, axes, origin), to_plane_frame(cavity, axes, origin)
    face, top = inner.slice(-0.3) ^ inner.slice(-0.05), high.bounding_box()[5]
    for radius in POUR_RADII_MM:
        places = _find_spots(face, radius + 0.8)
        if len(places):
            break
    else:
        raise FabricationError(
            f"cannot be cast: its largest face has no room for a pouring hole of"
            f" {2 * POUR_RADII_MM[-1]:g} mm",
            code="no-pouring-hole",
            where=name,
            action="Move the planes of its cords apart",
            part=name,
        )
    # At an end: along the longest axis.
    offsets = places - places.mean(axis=0)
    long_axis = np.linalg.svd(offsets - offsets.mean(axis=0), full_matrices=False)[2][0]
    pour = places[int(np.round(offsets @ long_axis, 3).argmax())]
    vents = _spread_points(
        _find_spots(face, VENT_RADIUS_MM + 0.5), MAX_VENTS, 3 * radius, pour[None]
    )
    holes = [
        _rod(radius, -0.5, top + 1, *pour),
        m3.Manifold.cylinder(2.5, radius, radius + FUNNEL_WIDENING_MM, 32).translate(
            [*pour, top - 2]
        ),
        *(_rod(VENT_RADIUS_MM, -0.5, top + 1, *v) for v in vents),
    ]
    high = high - union(holes)

    def world(points: Float) -> Float:
        flat_points = np.column_stack([points, np.zeros(len(points))])
        return np.asarray(origin + flat_points @ axes.T)

    return Feed(from_plane_frame(high, axes, origin), world(pour[None])[0], world(vents))


def _find_spots(section: Any, room: float) -> Float:
    """Return points (n, 2) of a CrossSection that keep `room` mm from its outline."""
    inner = section.offset(-room)
    outlines = [np.asarray(p, float) for p in inner.to_polygons()]
    if not outlines:
        return np.zeros((0, 2))
    x0, y0, x1, y1 = inner.bounds()
    step = max(0.5, float(np.sqrt(max(inner.area(), 1e-6) / MAX_SPOTS)))
    axes = [np.arange(a, b + step, step) for a, b in ((x0, x1), (y0, y1))]
    grid = np.stack(np.meshgrid(*axes), -1).reshape(-1, 2)
    return np.concatenate([*outlines, grid[inside_outlines(grid, outlines)]])


def _spread_points(points: Float, count: int, min_distance: float, chosen_before: Float) -> Float:
    """Choose points far from each other.

    Args:
        points: Candidates (n, 2), mm.
        count: Largest number of points.
        min_distance: Least distance between points, mm.
        chosen_before: Points (k, 2) chosen before.

    Returns:
        Points, each as far as possible from those before.
    """
    chosen: list[Float] = list(chosen_before)
    for _ in range(count if len(points) else 0):
        distance = distance_to_chosen(points, np.array(chosen).reshape(-1, 2))
        distance += 0.0 if chosen else min_distance
        k = int(np.round(distance, 6).argmax())
        if distance[k] < min_distance:
            break
        chosen.append(points[k])
    return np.array(chosen[len(chosen_before) :]).reshape(-1, 2)
