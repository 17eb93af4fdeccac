"""Part numbers, engraved into faces that vanish when the device is closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ..kernels.cutting_tools import Number, Tool
from .alignment_pins import Pin, gap
from .part_contacts import Contact, inside

#: Heights of the digits that are tried, mm, and their depth.
HEIGHTS = (7.0, 6.0, 5.0, 4.0, 3.2)
DEPTH = 0.6
_STROKE = 0.8  # mm; two lines of a 0.4 mm nozzle


@dataclass(frozen=True)
class Label:
    """An engraved number: part (index), contact (index), its middle (3,) mm, height mm, tools."""

    part: int
    contact: int
    center: Float
    height: float
    tools: tuple[Tool, ...]


def engrave(
    contacts: Sequence[Contact], pins: Sequence[Pin], count: int, wall: float
) -> list[Label]:
    """A label for each of `count` parts, numbered from 1, that has room for one: clear of grooves,
    pins and outlines by `wall` mm, the largest digits, on the face with most room."""
    out = []
    for part in range(count) if count > 1 else []:
        mine = [k for k, c in enumerate(contacts) if part in (c.lower, c.upper)]
        for height in HEIGHTS:
            text = Number(str(part + 1), height, _STROKE)
            free = [
                (spare, k, at, turned)
                for k in mine
                for turned in (False, True)
                for spare, at in _best(contacts[k], pins, _box(text, turned), wall)
            ]
            if free:
                _, k, at, turned = max(free, key=lambda f: f[0])
                out.append(_label(contacts[k], k, part, at, turned, text))
                break
    return out


def _box(text: Number, turned: bool) -> tuple[float, float]:
    """Half of a number's extent along x and y, mm."""
    x, y = text.size
    return (y / 2, x / 2) if turned else (x / 2, y / 2)


def _best(
    contact: Contact, pins: Sequence[Pin], half: tuple[float, float], wall: float
) -> list[tuple[float, Float]]:
    """The spot (2,) around which a box has the most room, and how much beyond the wall: one, or
    none where there is no room."""
    spots = contact.spots(min(half) + wall, most=120)
    ticks = np.linspace(-1, 1, 5)
    box = np.stack(np.meshgrid(ticks * half[0], ticks * half[1]), -1).reshape(-1, 2)
    if not len(spots):
        return []
    points = (spots[:, None] + box).reshape(-1, 2)
    enclosed = np.all(inside(points, contact.polygons).reshape(len(spots), -1), axis=1)
    spots, points = spots[enclosed], points.reshape(len(spots), -1, 2)[enclosed]
    if not len(spots):
        return []
    # A ball around the whole box settles most of them.
    around = float(np.hypot(*half)) + 3 * wall
    center = _distance(contact, spots, pins, around)
    spare = np.where(center >= around, 3 * wall, 0.0)
    near = np.flatnonzero((center < around) & (center >= min(half) + wall))
    flat = points[near].reshape(-1, 2)
    spare[near] = _distance(contact, flat, pins, 3 * wall).reshape(len(near), len(box)).min(axis=1)
    spare -= wall
    off = np.linalg.norm(spots - spots.mean(axis=0), axis=1)
    rank = np.where(spare >= 0, spare - 1e-3 * off, -np.inf)
    best = int(rank.argmax())
    return [(float(rank[best]), spots[best])] if np.isfinite(rank[best]) else []


def _distance(contact: Contact, flat: Float, pins: Sequence[Pin], most: float) -> Float:
    """Distance of points (n, 2) of the face from all that is in the way, up to `most` mm."""
    world = contact.world(flat)
    return np.asarray(np.minimum(contact.distance(world, most), gap(world, pins)))


def _label(contact: Contact, k: int, part: int, at: Float, turned: bool, text: Number) -> Label:
    axes = contact.plane.axes
    if turned:
        axes = np.stack([axes[:, 1], -axes[:, 0], axes[:, 2]], axis=1)
    if part == contact.upper:  # whose face looks down
        axes = axes * np.array([1.0, -1.0, -1.0])
    center = contact.world(at[None])[0]
    return Label(part, k, center, text.height, tuple(text.engraved(center, axes, DEPTH)))
