"""Place pins between parts, so that each part fits in one place only.

Every pair of parts that meet gets two sockets of different diameters in each of their faces, with
loose pins between them. Since the two differ, a part turned round does not fit. No two faces of a
device have their pins at the same distance, so that a part does not fit another's place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ..kernels.cutting_tools import Frustum, Tool, cylinder
from .part_contacts import Contact

#: Diameters (mm) of the two pins of a face, and their reach into each part in diameters. Smaller
#: and shorter ones follow for less room, but none less than 3 mm thick and 4 mm long.
PIN_SIZES = (((5.0, 4.0), 1.25), ((4.0, 3.0), 1.25), ((4.0, 3.0), 0.8), ((3.5, 3.0), 0.8))
#: Least difference between the distances of the pins of two faces.
MIN_DISTANCE_DIFFERENCE_MM = 1.0
END_GAP_MM = 0.3  # between a pin's end and the bottom of its socket
BEVEL_MM = 0.4  # of a pin's ends
MAX_CANDIDATES = 240
SLACK_MM = 5e-3  # rounding of outlines that were moved inwards


@dataclass(frozen=True)
class Pin:
    """A pin between two parts.

    Attributes:
        contact: Index of the contact that it crosses.
        center: Center (3,), mm.
        axis: Unit axis (3,), along the plane's normal.
        diameter: Diameter, mm.
        length: Length, mm.
        socket: Diameter of its sockets, mm.
        depth: Depth of each socket, mm.
    """

    contact: int
    center: Float
    axis: Float
    diameter: float
    length: float
    socket: float
    depth: float

    @property
    def shape(self) -> list[Tool]:
        """The loose pin, standing on z = 0: a cylinder with beveled ends."""
        up, r = np.array([0.0, 0.0, 1.0]), self.diameter / 2
        low, high = BEVEL_MM * up, (self.length - BEVEL_MM) * up
        thin = r - BEVEL_MM
        return [
            Frustum(0 * up, low, (thin, r)),
            cylinder(low, high, self.diameter),
            Frustum(high, self.length * up, (r, thin)),
        ]

    def socket_in(self, upper: bool) -> Tool:
        """Return the hole in the part above the plane, or below it, extended a little beyond the
        face.
        """
        out = self.axis if upper else -self.axis
        return cylinder(self.center - 0.5 * out, self.center + self.depth * out, self.socket)


def place_pins(contacts: Sequence[Contact], clearance: float, wall: float) -> list[Pin]:
    """Place two pins in each contact that has room; one or none otherwise.

    Larger contacts choose first. Pins lie as far apart as possible.

    Args:
        contacts: The contacts.
        clearance: Clearance on the diameter, mm.
        wall: Least wall, mm.
    """
    pins: list[Pin] = []
    used_distances: list[float] = []
    for k in sorted(range(len(contacts)), key=lambda k: -contacts[k].area):
        pins += _place_pair(contacts, k, clearance, wall, used_distances, pins)
    return pins


def _place_pair(
    contacts: Sequence[Contact],
    k: int,
    clearance: float,
    wall: float,
    used_distances: list[float],
    other_pins: Sequence[Pin],
) -> list[Pin]:
    contact = contacts[k]
    single_pin: list[Pin] = []
    for sizes, reach in PIN_SIZES:
        # A wider pin would take most of a small face.
        if sizes[0] > 0.4 * np.sqrt(contact.area) and sizes != PIN_SIZES[-1][0]:
            continue
        spots = [find_free_spots(contact, d, reach * d, clearance, wall, other_pins) for d in sizes]
        if not len(spots[1]):
            continue
        chosen = _farthest_pair(
            spots[0], spots[1], used_distances, sum(sizes) / 2 + clearance + wall
        )
        if chosen is not None:
            used_distances.append(float(np.linalg.norm(chosen[0] - chosen[1])))
            return [
                _make_pin(contact, k, spot, d, reach * d, clearance)
                for spot, d in zip(chosen, sizes, strict=True)
            ]
        if not single_pin:
            middle = spots[1].mean(axis=0)
            spot = spots[1][int(np.linalg.norm(spots[1] - middle, axis=1).argmin())]
            single_pin = [_make_pin(contact, k, spot, sizes[1], reach * sizes[1], clearance)]
    return single_pin


def _make_pin(
    contact: Contact, k: int, at: Float, diameter: float, depth: float, clearance: float
) -> Pin:
    return Pin(
        k,
        contact.world(at[None])[0],
        contact.plane.normal,
        diameter,
        2 * (depth - END_GAP_MM),
        diameter + clearance,
        depth,
    )


def find_free_spots(
    contact: Contact,
    diameter: float,
    depth: float,
    clearance: float,
    wall: float,
    other_pins: Sequence[Pin] = (),
) -> Float:
    """Return the points of a contact around which a socket leaves a wall on all sides.

    Args:
        contact: The contact.
        diameter: Diameter of the pin, mm.
        depth: Depth of the socket, mm.
        clearance: Clearance on the diameter, mm.
        wall: Least wall, also to the sockets of other pins, mm.
        other_pins: The other pins.

    Returns:
        Points (n, 2) of the plane, mm.
    """
    radius = (diameter + clearance) / 2
    spots = _sample(contact.spots(radius + wall))
    # Distances have no sign: points lie so close that none can pass through a skin unnoticed.
    heights = np.linspace(-depth, depth, 2 * int(np.ceil(depth / wall)) + 1)
    # A ball around the whole socket decides most of them.
    reach = float(np.hypot(radius, depth)) + wall
    center = _distance(contact, spots, np.zeros((1, 3)), other_pins, reach)[:, 0]
    clear_spots = spots[center >= reach]
    spots = spots[(center >= radius + wall - SLACK_MM) & (center < reach)]
    axis = np.column_stack([np.zeros((len(heights), 2)), heights])
    is_wide = _distance(contact, spots, axis, other_pins, radius + wall) >= radius + wall
    # The socket's surface may be too near only where its axis is nearer than that.
    is_free = np.ones(len(spots), bool)
    for k, height in enumerate(heights):
        narrow = np.flatnonzero(is_free & ~is_wide[:, k])
        points = socket_rings(radius, height, bottom=k in (0, len(heights) - 1))
        distances = _distance(contact, spots[narrow], points, other_pins, wall)
        is_free[narrow] = (distances >= wall - SLACK_MM).all(axis=1)
    return np.concatenate([clear_spots, spots[is_free]])


def _distance(
    contact: Contact, spots: Float, points: Float, other_pins: Sequence[Pin], max_distance: float
) -> Float:
    """Return the distance (n, p) of points (p, 3) around each of the spots (n, 2) from all
    obstacles, up to `max_distance` mm.
    """
    world = contact.world(spots)[:, None] + points @ contact.plane.axes.T
    flat = world.reshape(-1, 3)
    distances = np.minimum(
        contact.distance(flat, max_distance), distance_to_sockets(flat, other_pins)
    )
    return np.asarray(distances.reshape(len(spots), len(points)))


def socket_rings(radius: float, height: float, bottom: bool) -> Float:
    """Return points (n, 3) around a socket at a height along its axis, and on its bottom there, mm.

    Nowhere is the socket's surface nearer to anything by more than a fiftieth of the radius.
    """
    turn = np.arange(16) * np.pi / 8
    circle = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    parts = [circle / np.cos(np.pi / 16)]
    parts += [part * circle for part in (0.25, 0.5, 0.75)] if bottom else []
    flat = np.concatenate(parts)
    return np.column_stack([flat, np.full(len(flat), height)])


def distance_to_sockets(points: Float, pins: Sequence[Pin]) -> Float:
    """Return the distance (n,) of points (n, 3) from the nearest socket, mm."""
    out = np.full(len(points), np.inf)
    for pin in pins:
        along = np.clip((points - pin.center) @ pin.axis, -pin.depth, pin.depth)
        nearest = pin.center + along[:, None] * pin.axis
        out = np.minimum(out, np.linalg.norm(points - nearest, axis=1) - pin.socket / 2)
    return out


def _farthest_pair(
    first: Float, second: Float, used_distances: Sequence[float], min_distance: float
) -> tuple[Float, Float] | None:
    """Return the two points, one of each set (n, 2), that lie farthest apart at a distance that
    differs from those used, or None.
    """
    if not len(first):
        return None
    distance = np.linalg.norm(first[:, None] - second[None], axis=2)
    is_allowed = distance >= min_distance
    for distance_used in used_distances:
        is_allowed &= np.abs(distance - distance_used) >= MIN_DISTANCE_DIFFERENCE_MM
    if not is_allowed.any():
        return None
    i, j = np.unravel_index(np.where(is_allowed, distance, -1.0).argmax(), distance.shape)
    return first[i], second[j]


def _sample(points: Float) -> Float:
    """Return at most `MAX_CANDIDATES` of the points, at random."""
    rng = np.random.default_rng(0)
    return points[np.sort(rng.permutation(len(points))[:MAX_CANDIDATES])]
