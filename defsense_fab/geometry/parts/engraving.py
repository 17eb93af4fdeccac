"""Part numbers, engraved into faces that vanish when the device is closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.mesh import Surface
from ..kernels import surface_queries
from ..kernels.cutting_tools import Number, Prism, Tool, frame, upright
from .alignment_pins import Pin, gap
from .part_contacts import Contact, inside

# Flats on the skin for camera tags, with the tag's number engraved.

#: A seat lies at least this far below the skin around it, and at most that far, mm.
SHALLOW, DEEP = 0.3, 1.6
_PLAY = 0.4  # mm, that a seat is wider than its tag
_STROKE_TAG_SEATS, _ENGRAVED = 0.8, 0.4  # mm
_APART = 2.0  # mm, between two seats
_LEAN = np.cos(np.radians(40))  # of the skin's normals within a seat


@dataclass(frozen=True)
class Seat:
    """A square flat for tag `number`, `size` mm wide: its middle (3,) mm and `axes` (3, 3): the
    tag's x and y, and the normal out of the body."""

    number: int
    center: Float
    axes: Float
    size: float

    @property
    def tools(self) -> list[Tool]:
        """What is cut out of the body."""
        half = self.size / 2
        square = half * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
        text = Number(str(self.number), 0.5 * self.size, _STROKE_TAG_SEATS)
        flat: Tool = Prism(self.center, self.axes, square, 2 * DEEP)
        return [flat, *text.engraved(self.center, self.axes, _ENGRAVED)]


def place_seats(
    body: Surface,
    count: int,
    tag: float,
    hollows: Sequence[tuple[Float, float]],
    wall: float,
    planes: Sequence[Plane] = (),
) -> list[Seat]:
    """Up to `count` seats for square tags of `tag` mm, spread over the skin where it is nearly
    flat, at least `wall` mm of material between them and the `hollows`: points (n, 3) mm and the
    radius of what is hollow there. Places that the `planes` of cords cross come last: tags should
    not lie over joints."""
    if not count:
        return []
    size = tag + _PLAY
    points, normals = surface_queries.samples(body, size)
    tree = cKDTree(points)
    round_ = size / np.sqrt(2)
    keep = _Keep(hollows, round_, wall + _ENGRAVED)
    rng = np.random.default_rng(0)
    found: list[tuple[Float, Float]] = []
    for k in rng.permutation(len(points)):
        near = np.array(tree.query_ball_point(points[k], 1.6 * round_))
        # A thin body's other skin is near too: only what looks the same way counts.
        near = near[normals[near] @ normals[k] > 0]
        offset = points[near] - points[k]
        normal = normals[near][np.linalg.norm(offset, axis=1) <= round_].mean(axis=0)
        normal /= np.linalg.norm(normal)
        height = offset @ normal
        aside = np.linalg.norm(offset - height[:, None] * normal, axis=1)
        under = aside < round_
        if (normals[near][under] @ normal).min() < _LEAN or not _covered(offset[under], normal):
            continue
        low, high = float(height[under].min()) - SHALLOW, float(height[under].max())
        if high - low > DEEP:
            continue
        center = points[k] + low * normal
        if keep.clear(center, normal):
            found.append((center, normal))
    clear = [all(abs(float((c - p.origin) @ p.normal)) > round_ for p in planes) for c, _ in found]
    return [
        Seat(n + 1, center, upright(normal), size)
        for n, (center, normal) in enumerate(_spread(found, clear, count, 2 * round_ + _APART))
    ]


def _covered(offset: Float, normal: Float) -> bool:
    """Whether points lie on all sides: not at the rim of a flat face."""
    x, y = frame(normal)[:, :2].T
    distance = np.linalg.norm(offset, axis=1)
    outer = offset[distance > 0.6 * distance.max()]
    angle = np.sort(np.arctan2(outer @ y, outer @ x))
    if len(angle) < 4:
        return False
    gaps = np.diff(np.concatenate([angle, angle[:1] + 2 * np.pi]))
    return bool(gaps.max() < np.radians(75))


class _Keep:
    """Whether discs of one `radius` leave `wall` mm to hollows: points (n, 3) mm and a radius."""

    def __init__(self, hollows: Sequence[tuple[Float, float]], radius: float, wall: float) -> None:
        self._radius = radius
        self._points = np.concatenate([np.zeros((0, 3)), *(p for p, _ in hollows)])
        self._least = np.concatenate(
            [np.zeros(0), *(np.full(len(p), r + wall) for p, r in hollows)]
        )
        self._tree = cKDTree(self._points)
        self._reach = radius + float(self._least.max(initial=0.0))

    def clear(self, center: Float, normal: Float) -> bool:
        near = self._tree.query_ball_point(center, self._reach)
        offset = self._points[near] - center
        height = offset @ normal
        aside = np.linalg.norm(offset - height[:, None] * normal, axis=1)
        gap = np.hypot(height, np.maximum(aside - self._radius, 0.0))
        return bool((gap >= self._least[near]).all())


def _spread(
    found: Sequence[tuple[Float, Float]], clear: Sequence[bool], count: int, apart: float
) -> list[tuple[Float, Float]]:
    """Farthest-point sampling of at most `count`, no two nearer than `apart` mm: first among those
    that are `clear`, then among all."""
    if not found:
        return []
    points = np.array([c for c, _ in found])
    chosen: list[int] = []
    for allowed in (np.array(clear), np.ones(len(found), bool)):
        while allowed.any() and len(chosen) < min(count, len(found)):
            if chosen:
                gap = np.linalg.norm(points[:, None] - points[chosen][None], axis=2).min(axis=1)
            else:
                gap = apart + np.linalg.norm(points - points.mean(axis=0), axis=1)
            best = int(np.where(allowed, gap, -1.0).argmax())
            if gap[best] < apart:
                break
            chosen.append(best)
    return [found[i] for i in chosen]


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
