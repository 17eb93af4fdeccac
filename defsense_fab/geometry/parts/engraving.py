"""Engrave numbers: of parts, in faces that vanish when the device is closed, and of tag seats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.mesh import Surface
from ..kernels.cutting_tools import Number, Prism, Tool, axes_from_normal, upright_axes
from ..kernels.surface_queries import distance_to_chosen, inside_outlines, sample_skin
from .alignment_pins import Pin, distance_to_sockets
from .part_contacts import Contact

#: Least and largest depth of a seat below the skin around it.
MIN_SEAT_DEPTH_MM, MAX_SEAT_DEPTH_MM = 0.3, 1.6
SEAT_PLAY_MM = 0.4  # by which a seat is wider than its tag
SEAT_STROKE_MM, SEAT_ENGRAVING_MM = 0.8, 0.4  # mm
SEAT_GAP_MM = 2.0  # between two seats
MIN_LEAN_COSINE = np.cos(np.radians(40))  # between the skin's normals within a seat


@dataclass(frozen=True)
class Seat:
    """A square flat for a camera tag.

    Attributes:
        number: Number of the tag.
        center: Center (3,), mm.
        axes: Axes (3, 3) in columns: the tag's x and y, and the normal out of the body.
        size: Width, mm.
    """

    number: int
    center: Float
    axes: Float
    size: float

    @property
    def tools(self) -> list[Tool]:
        """Tools that cut it out of the body."""
        half = self.size / 2
        square = half * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
        text = Number(str(self.number), 0.5 * self.size, SEAT_STROKE_MM)
        flat: Tool = Prism(self.center, self.axes, square, 2 * MAX_SEAT_DEPTH_MM)
        return [flat, *text.engraved(self.center, self.axes, SEAT_ENGRAVING_MM)]


def place_seats(
    body: Surface,
    count: int,
    tag: float,
    hollows: Sequence[tuple[Float, float]],
    wall: float,
    planes: Sequence[Plane] = (),
) -> list[Seat]:
    """Place seats for square tags, spread over the skin where it is nearly flat.

    Places that the planes of cords cross come last: tags should not lie over joints.

    Args:
        body: Surface of the body.
        count: Largest number of seats.
        tag: Side of a tag, mm.
        hollows: Points (n, 3) along each hollow, and its radius, mm.
        wall: Least material between seats and hollows, mm.
        planes: Planes of the cords.
    """
    if not count:
        return []
    size = tag + SEAT_PLAY_MM
    points, normals = sample_skin(body, size)
    tree = cKDTree(points)
    reach = size / np.sqrt(2)
    clearance = _Clearance(hollows, reach, wall + SEAT_ENGRAVING_MM)
    rng = np.random.default_rng(0)
    places: list[tuple[Float, Float]] = []
    for k in rng.permutation(len(points)):
        neighbors = np.array(tree.query_ball_point(points[k], 1.6 * reach))
        # The opposite skin of a thin body is near, too: only points that face the same way count.
        neighbors = neighbors[normals[neighbors] @ normals[k] > 0]
        offset = points[neighbors] - points[k]
        normal = normals[neighbors][np.linalg.norm(offset, axis=1) <= reach].mean(axis=0)
        normal /= np.linalg.norm(normal)
        height = offset @ normal
        sideways = np.linalg.norm(offset - height[:, None] * normal, axis=1)
        is_under = sideways < reach
        if (normals[neighbors][is_under] @ normal).min() < MIN_LEAN_COSINE or not _is_covered(
            offset[is_under], normal
        ):
            continue
        low, high = float(height[is_under].min()) - MIN_SEAT_DEPTH_MM, float(height[is_under].max())
        if high - low > MAX_SEAT_DEPTH_MM:
            continue
        center = points[k] + low * normal
        if clearance.is_clear(center, normal):
            places.append((center, normal))
    is_clear = [
        all(abs(float((c - p.origin) @ p.normal)) > reach for p in planes) for c, _ in places
    ]
    return [
        Seat(n + 1, center, upright_axes(normal), size)
        for n, (center, normal) in enumerate(
            _spread(places, is_clear, count, 2 * reach + SEAT_GAP_MM)
        )
    ]


def _is_covered(offset: Float, normal: Float) -> bool:
    """Whether points lie on all sides: not at the rim of a flat face."""
    x, y = axes_from_normal(normal)[:, :2].T
    distance = np.linalg.norm(offset, axis=1)
    outer = offset[distance > 0.6 * distance.max()]
    angle = np.sort(np.arctan2(outer @ y, outer @ x))
    if len(angle) < 4:
        return False
    gaps = np.diff(np.concatenate([angle, angle[:1] + 2 * np.pi]))
    return bool(gaps.max() < np.radians(75))


class _Clearance:
    """Whether discs of one radius leave `wall` mm to hollows: points (n, 3) and a radius, mm."""

    def __init__(self, hollows: Sequence[tuple[Float, float]], radius: float, wall: float) -> None:
        self._radius = radius
        self._points = np.concatenate([np.zeros((0, 3)), *(p for p, _ in hollows)])
        self._least = np.concatenate(
            [np.zeros(0), *(np.full(len(p), r + wall) for p, r in hollows)]
        )
        self._tree = cKDTree(self._points)
        self._reach = radius + float(self._least.max(initial=0.0))

    def is_clear(self, center: Float, normal: Float) -> bool:
        """Whether a disc with this center (3,) and normal (3,) leaves the wall."""
        neighbors = self._tree.query_ball_point(center, self._reach)
        offset = self._points[neighbors] - center
        height = offset @ normal
        sideways = np.linalg.norm(offset - height[:, None] * normal, axis=1)
        distance = np.hypot(height, np.maximum(sideways - self._radius, 0.0))
        return bool((distance >= self._least[neighbors]).all())


def _spread(
    places: Sequence[tuple[Float, Float]], is_clear: Sequence[bool], count: int, min_distance: float
) -> list[tuple[Float, Float]]:
    """Choose at most `count` places at least `min_distance` mm apart by farthest-point sampling:
    first among those that are clear, then among all.
    """
    if not places:
        return []
    points = np.array([c for c, _ in places])
    chosen: list[int] = []
    for is_allowed in (np.array(is_clear), np.ones(len(places), bool)):
        while is_allowed.any() and len(chosen) < min(count, len(places)):
            distance = distance_to_chosen(points, points[chosen])
            distance += 0.0 if chosen else min_distance
            best = int(np.where(is_allowed, distance, -1.0).argmax())
            if distance[best] < min_distance:
                break
            chosen.append(best)
    return [places[i] for i in chosen]


#: Heights of digits, the first that fits is taken; and their depth.
DIGIT_HEIGHTS_MM = (7.0, 6.0, 5.0, 4.0, 3.2)
ENGRAVING_DEPTH_MM = 0.6
STROKE_MM = 0.8  # mm; two lines of a 0.4 mm nozzle


@dataclass(frozen=True)
class Label:
    """An engraved part number.

    Attributes:
        part: Index of the part.
        contact: Index of the contact in whose face it is.
        center: Center (3,), mm.
        height: Height of the digits, mm.
        tools: Tools that engrave it.
    """

    part: int
    contact: int
    center: Float
    height: float
    tools: tuple[Tool, ...]


def engrave_numbers(
    contacts: Sequence[Contact], pins: Sequence[Pin], count: int, wall: float
) -> list[Label]:
    """Engrave a number on each part that has room for one.

    Parts are numbered from 1. Numbers keep `wall` mm from grooves, pins and outlines; the largest
    digits are taken, on the face with most room.

    Args:
        contacts: Contacts of the parts.
        pins: Pins in them.
        count: Number of parts.
        wall: Least wall, mm.
    """
    out = []
    for part in range(count) if count > 1 else []:
        part_contacts = [k for k, c in enumerate(contacts) if part in (c.lower, c.upper)]
        for height in DIGIT_HEIGHTS_MM:
            text = Number(str(part + 1), height, STROKE_MM)
            free = [
                (spare, k, at, is_turned)
                for k in part_contacts
                for is_turned in (False, True)
                for spare, at in _find_spot(contacts[k], pins, _half_extent(text, is_turned), wall)
            ]
            if free:
                _, k, at, is_turned = max(free, key=lambda f: f[0])
                out.append(_make_label(contacts[k], k, part, at, is_turned, text))
                break
    return out


def _half_extent(text: Number, is_turned: bool) -> tuple[float, float]:
    """Return half of a number's extent along x and y, mm."""
    x, y = text.size
    return (y / 2, x / 2) if is_turned else (x / 2, y / 2)


def _find_spot(
    contact: Contact, pins: Sequence[Pin], half: tuple[float, float], wall: float
) -> list[tuple[float, Float]]:
    """Return the spot (2,) with most room around a box, and that room beyond the wall: one, or
    none.
    """
    spots = contact.spots(min(half) + wall, max_spots=120)
    ticks = np.linspace(-1, 1, 5)
    box = np.stack(np.meshgrid(ticks * half[0], ticks * half[1]), -1).reshape(-1, 2)
    if not len(spots):
        return []
    points = (spots[:, None] + box).reshape(-1, 2)
    is_enclosed = np.all(inside_outlines(points, contact.polygons).reshape(len(spots), -1), axis=1)
    spots, points = spots[is_enclosed], points.reshape(len(spots), -1, 2)[is_enclosed]
    if not len(spots):
        return []
    # A ball around the whole box decides most of them.
    reach = float(np.hypot(*half)) + 3 * wall
    center = _distance(contact, spots, pins, reach)
    room = np.where(center >= reach, 3 * wall, 0.0)
    uncertain = np.flatnonzero((center < reach) & (center >= min(half) + wall))
    flat = points[uncertain].reshape(-1, 2)
    room[uncertain] = (
        _distance(contact, flat, pins, 3 * wall).reshape(len(uncertain), len(box)).min(axis=1)
    )
    room -= wall
    offset = np.linalg.norm(spots - spots.mean(axis=0), axis=1)
    rank = np.where(room >= 0, room - 1e-3 * offset, -np.inf)
    best = int(rank.argmax())
    return [(float(rank[best]), spots[best])] if np.isfinite(rank[best]) else []


def _distance(contact: Contact, flat: Float, pins: Sequence[Pin], max_distance: float) -> Float:
    """Return the distance of points (n, 2) of the face to obstacles, at most `max_distance` mm."""
    world = contact.world(flat)
    return np.asarray(
        np.minimum(contact.distance(world, max_distance), distance_to_sockets(world, pins))
    )


def _make_label(
    contact: Contact, k: int, part: int, at: Float, is_turned: bool, text: Number
) -> Label:
    axes = contact.plane.axes
    if is_turned:
        axes = np.stack([axes[:, 1], -axes[:, 0], axes[:, 2]], axis=1)
    if part == contact.upper:  # whose face points down
        axes = axes * np.array([1.0, -1.0, -1.0])
    center = contact.world(at[None])[0]
    return Label(
        part, k, center, text.height, tuple(text.engraved(center, axes, ENGRAVING_DEPTH_MM))
    )
