"""Pins between parts: where there is room, and so that no part fits where it does not belong.

Every pair of parts that meet gets two sockets of different diameters in each of their faces, with
loose pins between them. The two differ, so a part turned round does not fit; and no two faces of a
device have their pins equally far apart, so a part does not fit another's place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ..kernels.cutting_tools import Frustum, Tool, cylinder
from .part_contacts import Contact

#: Diameters of the two pins of a face and how many diameters they reach into each part: smaller
#: and shorter ones where there is less room, but none that is less than 3 mm thick and 4 mm long.
SIZES = (((5.0, 4.0), 1.25), ((4.0, 3.0), 1.25), ((4.0, 3.0), 0.8), ((3.5, 3.0), 0.8))
#: Distances between the pins of two faces differ by at least this, mm.
APART = 1.0
_END_GAP = 0.3  # mm, between a pin's end and the bottom of its socket
_BEVEL = 0.4  # mm, of a pin's ends
_CANDIDATES = 240
_SLACK = 5e-3  # mm, of rounding in outlines that were moved inwards


@dataclass(frozen=True)
class Pin:
    """A pin of `diameter` and `length` mm through the contact (an index) at `center` (3,) mm, its
    axis along the plane's normal; its sockets have the diameter `socket` and reach `depth` mm into
    both parts."""

    contact: int
    center: Float
    axis: Float
    diameter: float
    length: float
    socket: float
    depth: float

    @property
    def shape(self) -> list[Tool]:
        """The loose pin itself, standing on z = 0: a cylinder with bevelled ends."""
        up, r = np.array([0.0, 0.0, 1.0]), self.diameter / 2
        low, high = _BEVEL * up, (self.length - _BEVEL) * up
        thin = r - _BEVEL
        return [
            Frustum(0 * up, low, (thin, r)),
            cylinder(low, high, self.diameter),
            Frustum(high, self.length * up, (r, thin)),
        ]

    def socket_in(self, upper: bool) -> Tool:
        """The hole in the part above the plane, or below it, a little longer than it is deep."""
        out = self.axis if upper else -self.axis
        return cylinder(self.center - 0.5 * out, self.center + self.depth * out, self.socket)


def place_pins(contacts: Sequence[Contact], clearance: float, wall: float) -> list[Pin]:
    """Two pins for each contact where they have room, one or none where not.

    `clearance` (on the diameter) and `wall` in mm. Larger contacts choose first. Pins lie as far
    apart as they can.
    """
    pins: list[Pin] = []
    taken: list[float] = []
    for k in sorted(range(len(contacts)), key=lambda k: -contacts[k].area):
        pins += _pair(contacts, k, clearance, wall, taken, pins)
    return pins


def _pair(
    contacts: Sequence[Contact],
    k: int,
    clearance: float,
    wall: float,
    taken: list[float],
    known: Sequence[Pin],
) -> list[Pin]:
    contact = contacts[k]
    single: list[Pin] = []
    for sizes, reach in SIZES:
        # A pin wider than a fifth of a small face would be most of it.
        if sizes[0] > 0.4 * np.sqrt(contact.area) and sizes != SIZES[-1][0]:
            continue
        spots = [free_spots(contact, d, reach * d, clearance, wall, known) for d in sizes]
        if not len(spots[1]):
            continue
        chosen = _farthest(spots[0], spots[1], taken, sum(sizes) / 2 + clearance + wall)
        if chosen is not None:
            taken.append(float(np.linalg.norm(chosen[0] - chosen[1])))
            return [
                _pin(contact, k, at, d, reach * d, clearance)
                for at, d in zip(chosen, sizes, strict=True)
            ]
        if not single:
            middle = spots[1].mean(axis=0)
            at = spots[1][int(np.linalg.norm(spots[1] - middle, axis=1).argmin())]
            single = [_pin(contact, k, at, sizes[1], reach * sizes[1], clearance)]
    return single


def _pin(
    contact: Contact, k: int, at: Float, diameter: float, depth: float, clearance: float
) -> Pin:
    return Pin(
        k,
        contact.world(at[None])[0],
        contact.plane.normal,
        diameter,
        2 * (depth - _END_GAP),
        diameter + clearance,
        depth,
    )


def free_spots(
    contact: Contact,
    diameter: float,
    depth: float,
    clearance: float,
    wall: float,
    known: Sequence[Pin] = (),
) -> Float:
    """Points (n, 2) of the plane around which sockets `depth` mm deep leave a wall on all sides,
    to the sockets of `known` pins too."""
    radius = (diameter + clearance) / 2
    spots = _few(contact.spots(radius + wall))
    # Distances have no sign: points lie so close that none can step through a skin unnoticed.
    heights = np.linspace(-depth, depth, 2 * int(np.ceil(depth / wall)) + 1)
    # A ball around the whole socket settles most of them.
    around = float(np.hypot(radius, depth)) + wall
    center = _distance(contact, spots, np.zeros((1, 3)), known, around)[:, 0]
    open_ = spots[center >= around]
    spots = spots[(center >= radius + wall - _SLACK) & (center < around)]
    axis = np.column_stack([np.zeros((len(heights), 2)), heights])
    wide = _distance(contact, spots, axis, known, radius + wall) >= radius + wall
    # Only where the axis is nearer than that, the socket's surface may be too near.
    free = np.ones(len(spots), bool)
    for k, height in enumerate(heights):
        narrow = np.flatnonzero(free & ~wide[:, k])
        points = rings(radius, height, bottom=k in (0, len(heights) - 1))
        found = _distance(contact, spots[narrow], points, known, wall)
        free[narrow] = (found >= wall - _SLACK).all(axis=1)
    return np.concatenate([open_, spots[free]])


def _distance(
    contact: Contact, spots: Float, points: Float, known: Sequence[Pin], most: float
) -> Float:
    """Distance of points (p, 3) mm around each of the spots (n, 2) from all that is in the way,
    up to `most` mm: (n, p)."""
    world = contact.world(spots)[:, None] + points @ contact.plane.axes.T
    flat = world.reshape(-1, 3)
    found = np.minimum(contact.distance(flat, most), gap(flat, known))
    return np.asarray(found.reshape(len(spots), len(points)))


def rings(radius: float, height: float, bottom: bool) -> Float:
    """Points (n, 3) mm around a socket at a height (mm) along its axis, and on its bottom there:
    nowhere is its surface nearer to anything by more than a fiftieth of the radius."""
    turn = np.arange(16) * np.pi / 8
    circle = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    parts = [circle / np.cos(np.pi / 16)]
    parts += [part * circle for part in (0.25, 0.5, 0.75)] if bottom else []
    flat = np.concatenate(parts)
    return np.column_stack([flat, np.full(len(flat), height)])


def gap(points: Float, pins: Sequence[Pin]) -> Float:
    """Distance (n,) mm of points (n, 3) from the nearest socket."""
    out = np.full(len(points), np.inf)
    for pin in pins:
        along = np.clip((points - pin.center) @ pin.axis, -pin.depth, pin.depth)
        nearest = pin.center + along[:, None] * pin.axis
        out = np.minimum(out, np.linalg.norm(points - nearest, axis=1) - pin.socket / 2)
    return out


def _farthest(
    first: Float, second: Float, used: Sequence[float], least: float
) -> tuple[Float, Float] | None:
    """The two points, one of each set (n, 2), that lie farthest apart at a distance that differs
    from those used; None where there are none."""
    if not len(first):
        return None
    distance = np.linalg.norm(first[:, None] - second[None], axis=2)
    allowed = distance >= least
    for known in used:
        allowed &= np.abs(distance - known) >= APART
    if not allowed.any():
        return None
    i, j = np.unravel_index(np.where(allowed, distance, -1.0).argmax(), distance.shape)
    return first[i], second[j]


def _few(points: Float) -> Float:
    """At most `_CANDIDATES` of the points, a fair share of them."""
    rng = np.random.default_rng(0)
    return points[np.sort(rng.permutation(len(points))[:_CANDIDATES])]
