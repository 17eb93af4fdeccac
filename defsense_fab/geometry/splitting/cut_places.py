"""Choose where to cut a part across: as it lies on the bed, and away from what must not be cut."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...core.device.regions import Shape, hull_points
from ...core.mesh import Surface
from ..parts.records import Part, PartSet
from ..printing.print_bed import fits_bed, lay_flat

#: Least length of a piece.
MIN_PIECE_MM = 25.0
HEIGHT_STEP_MM = 1.0  # between compared heights
CLEARANCE_MM = 2.0  # from pins, ends of cords and numbers


def rank_cut_heights(
    part_set: PartSet, index: int, normal: Float, reach: float, kept: Sequence[Shape] = ()
) -> Float:
    """Return heights at which a piece may be cut off a part, the best first.

    The best height spoils the least, and then gives pieces of about equal length. None cuts a
    region that is kept whole.

    Args:
        part_set: The parts.
        index: Index of the part.
        normal: Unit normal (3,) of the cut.
        reach: Largest length of a piece, mm.
        kept: Bounded regions that are kept whole.

    Returns:
        Heights (n,) along the normal, mm.
    """
    heights = part_set.parts[index].surface.vertices @ normal
    low, high = float(heights.min()), float(heights.max())
    pieces = int(np.ceil((high - low) / reach))
    ideal = low + (high - low) / pieces
    candidates = np.arange(
        max(low + MIN_PIECE_MM, high - (pieces - 1) * reach),
        min(low + reach, high - MIN_PIECE_MM) + 1e-6,
        HEIGHT_STEP_MM,
    )
    candidates = candidates if len(candidates) else np.array([min(ideal, low + reach)])
    for shape in kept:
        span = hull_points(shape) @ normal
        is_below = candidates < span.min() - CLEARANCE_MM
        candidates = candidates[is_below | (candidates > span.max() + CLEARANCE_MM)]
    room = _clearance(part_set, index, candidates, normal)
    # If every place cuts something, as little of it as possible.
    order = np.lexsort((np.abs(candidates - ideal), -np.minimum(room, 0.0)))
    return np.asarray(candidates[order])


def longest_piece(part: Part, bed: tuple[float, float, float]) -> tuple[Float, float]:
    """Return the direction in which a part is longest as it lies on the bed.

    Args:
        part: The part.
        bed: Size of the bed, mm.

    Returns:
        The unit direction (3,) in the device's frame, and how long a piece of the part may be along
        it so that a box of the part's width and height fits the bed, mm.
    """
    flat = lay_flat(part.surface, part.down)
    size = np.ptp(flat.bounds, axis=0)
    along = int(size.argmax())
    direction = _bed_axes(part.surface.vertices, flat.vertices)[along]
    for length in np.arange(float(size[along]), MIN_PIECE_MM, -0.5):
        box = size.copy()
        box[along] = length
        corners = np.array(
            [[x, y, z] for x in (0, box[0]) for y in (0, box[1]) for z in (0, box[2])]
        )
        if fits_bed(Surface(corners, np.array([[0, 1, 2]])), bed):
            return direction, float(length)
    return direction, 0.0


def find_spoiled(part_set: PartSet, index: int, height: float, normal: Float) -> list[str]:
    """Return what a plane at this height, mm, cuts or comes too near to."""
    names = [
        what
        for what, middle, half in _find_obstacles(part_set, index, normal)
        if abs(height - middle) < half + CLEARANCE_MM
    ]
    return list(dict.fromkeys(names))


def _clearance(part_set: PartSet, index: int, heights: Float, normal: Float) -> Float:
    """Return how far (n,) planes at these heights keep from what they must not cut beyond the need,
    mm.
    """
    spared = _find_obstacles(part_set, index, normal)
    if not spared:
        return np.full(len(heights), np.inf)
    _, middles, halves = (np.array(v) for v in zip(*spared, strict=True))
    gaps = np.abs(heights[:, None] - middles) - halves - CLEARANCE_MM
    return np.asarray(gaps.min(axis=1))


def _find_obstacles(part_set: PartSet, index: int, normal: Float) -> list[tuple[str, float, float]]:
    """Return what must not be cut of a part: its name, its middle along the normal, and its half
    width, mm.
    """
    out = []
    for pin in part_set.pins:
        contact = part_set.contacts[pin.contact]
        if index in (contact.lower, contact.upper):
            across = np.sqrt(max(0.0, 1 - float(pin.axis @ normal) ** 2)) * pin.socket / 2
            half = abs(float(pin.axis @ normal)) * pin.depth + across
            out.append(("a pin's socket", float(pin.center @ normal), half))
    out += [
        ("a number", float(label.center @ normal), label.height)
        for label in part_set.labels
        if label.part == index
    ]
    low, high = part_set.parts[index].surface.bounds + np.array([[-1.0], [1.0]])

    def is_in_part(point: Float) -> bool:
        return bool((point >= low).all() and (point <= high).all())

    out += [
        (f"an end of cord {channel.name}", float(end.mouth @ normal), max(end.pocket, 3.0) + 3.0)
        for channel in part_set.channels
        for end in channel.ends
        if is_in_part(end.mouth)
    ]
    out += [
        ("a marker seat", float(seat.center @ normal), 0.75 * seat.size)
        for seat in part_set.seats
        if is_in_part(seat.center)
    ]
    return out


def _bed_axes(world: Float, on_bed: Float) -> Float:
    """Return the axes (3, 3) of the bed in the frame of the device, in rows."""
    a, b = world - world.mean(axis=0), on_bed - on_bed.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    return np.asarray(u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v)
