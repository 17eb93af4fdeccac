"""Where a part may be cut across: as it lies on the bed, and away from what must not be cut."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface
from ..kernels.cutting_tools import Prism
from ..parts.engraving import Seat
from ..parts.records import PartSet, Part
from ..printing.print_bed import fits, laid

#: Least length of a piece, mm.
SHORTEST = 25.0
_STEP = 1.0  # mm, between the places that are tried
_CLEAR = 2.0  # mm, from pins, ends of cords and numbers


def cut_heights(made: PartSet, index: int, normal: Float, reach: float) -> Float:
    """Heights (n,) mm along `normal` at which a piece of at most `reach` mm may be cut off a part,
    the best first: where the least is cut that should not be, and pieces are about equally long."""
    heights = made.parts[index].surface.vertices @ normal
    low, high = float(heights.min()), float(heights.max())
    pieces = int(np.ceil((high - low) / reach))
    ideal = low + (high - low) / pieces
    tried = np.arange(
        max(low + SHORTEST, high - (pieces - 1) * reach),
        min(low + reach, high - SHORTEST) + 1e-6,
        _STEP,
    )
    tried = tried if len(tried) else np.array([min(ideal, low + reach)])
    room = _clearance(made, index, tried, normal)
    # Where every place cuts something, as little of it as can be.
    order = np.lexsort((np.abs(tried - ideal), -np.minimum(room, 0.0)))
    return np.asarray(tried[order])


def long_way(part: Part) -> Float:
    """The direction (3,) in which the part is longest as it lies."""
    flat = laid(part.surface, part.down)
    turned, _ = _rotation(part.surface.vertices, flat.vertices)
    return np.asarray(turned[int(np.ptp(flat.bounds, axis=0).argmax())])


def reach(part: Part, normal: Float, bed: tuple[float, float, float]) -> float:
    """How long a box of the part's width and height may be, mm."""
    flat = laid(part.surface, part.down)
    rows, _ = _rotation(part.surface.vertices, flat.vertices)
    along = int(np.abs(rows @ normal).argmax())
    size = np.ptp(flat.bounds, axis=0)
    for length in np.arange(float(size[along]), SHORTEST, -0.5):
        box = size.copy()
        box[along] = length
        corners = np.array(
            [[x, y, z] for x in (0, box[0]) for y in (0, box[1]) for z in (0, box[2])]
        )
        if fits(Surface(corners, np.array([[0, 1, 2]])), bed):
            return float(length)
    return 0.0


def cut_by(made: PartSet, index: int, height: float, normal: Float) -> list[str]:
    """What a plane at the height (mm) comes too near to, or cuts."""
    found = [
        what
        for what, middle, half in _spared(made, index, normal)
        if abs(height - middle) < half + _CLEAR
    ]
    return list(dict.fromkeys(found))


def _clearance(made: PartSet, index: int, heights: Float, normal: Float) -> Float:
    """How far (n,) planes at these heights keep from what they must not cut, less what they have
    to, mm."""
    spared = _spared(made, index, normal)
    if not spared:
        return np.full(len(heights), np.inf)
    _, middles, halves = (np.array(v) for v in zip(*spared, strict=True))
    gaps = np.abs(heights[:, None] - middles) - halves - _CLEAR
    return np.asarray(gaps.min(axis=1))


def _spared(made: PartSet, index: int, normal: Float) -> list[tuple[str, float, float]]:
    """What must not be cut of a part: its name, where its middle is along the normal, and how far
    it reaches to either side, mm."""
    out = []
    for pin in made.pins:
        contact = made.contacts[pin.contact]
        if index in (contact.lower, contact.upper):
            across = np.sqrt(max(0.0, 1 - float(pin.axis @ normal) ** 2)) * pin.socket / 2
            half = abs(float(pin.axis @ normal)) * pin.depth + across
            out.append(("a pin's socket", float(pin.center @ normal), half))
    out += [
        ("a number", float(label.center @ normal), label.height)
        for label in made.labels
        if label.part == index
    ]
    low, high = made.parts[index].surface.bounds + np.array([[-1.0], [1.0]])

    def here(point: Float) -> bool:
        return bool((point >= low).all() and (point <= high).all())

    out += [
        (f"an end of cord {channel.name}", float(end.mouth @ normal), max(end.pocket, 3.0) + 3.0)
        for channel in made.channels
        for end in channel.ends
        if here(end.mouth)
    ]
    out += [
        ("a marker seat", float(seat.center @ normal), 0.75 * _side(seat))
        for seat in made.seats
        if here(seat.center)
    ]
    return out


def _side(seat: Seat) -> float:
    """The side of a marker seat, mm, by the tools that cut it."""
    points = [t.polygon for t in seat.tools if isinstance(t, Prism)]
    return float(max((np.ptp(p, axis=0).max() for p in points), default=10.0))


def _rotation(world: Float, lying: Float) -> tuple[Float, Float]:
    """Rows: the axes of the bed in the frame of the device; and the shift."""
    a, b = world - world.mean(axis=0), lying - lying.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    return u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v, world.mean(axis=0)
