"""Split the arcs of G-code (G2, G3) into chords."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

#: Largest distance between an arc and its chords, mm.
ARC_SAG_MM = 0.005


def split_arc(
    start: Sequence[float], end: Sequence[float], words: Mapping[str, float], is_clockwise: bool
) -> list[list[float]]:
    """Return points along an arc, from its start to its end.

    Args:
        start: Start (3,), mm.
        end: End (3,), mm; a helix if z differs.
        words: Center relative to the start as I and J, or the radius R, mm.
        is_clockwise: True for G2.

    Returns:
        Points as lists (3,), mm. Without a usable center or radius they are start and end.
    """
    center = _find_center(start, end, words, is_clockwise)
    if center is None:
        return [list(start), list(end)]
    radius = math.hypot(start[0] - center[0], start[1] - center[1])
    first = math.atan2(start[1] - center[1], start[0] - center[0])
    angle = math.atan2(end[1] - center[1], end[0] - center[0]) - first
    angle %= 2 * math.pi
    if angle < 1e-9:  # a full turn ends where it starts
        angle = 2 * math.pi
    elif is_clockwise:
        angle = 2 * math.pi - angle
    step = 2 * math.acos(max(1 - ARC_SAG_MM / max(radius, ARC_SAG_MM), 0.5))
    count = max(1, math.ceil(angle / step))
    sign = -1.0 if is_clockwise else 1.0
    points = [list(start)]
    for i in range(1, count):
        turned = first + sign * angle * i / count
        z = start[2] + (end[2] - start[2]) * i / count
        points.append(
            [center[0] + radius * math.cos(turned), center[1] + radius * math.sin(turned), z]
        )
    return [*points, list(end)]


def _find_center(
    start: Sequence[float], end: Sequence[float], words: Mapping[str, float], is_clockwise: bool
) -> tuple[float, float] | None:
    if "I" in words or "J" in words:
        i, j = words.get("I", 0.0), words.get("J", 0.0)
        return (start[0] + i, start[1] + j) if i or j else None
    radius = words.get("R", 0.0)
    dx, dy = end[0] - start[0], end[1] - start[1]
    chord = math.hypot(dx, dy)
    if not radius or not chord:
        return None
    rise = math.sqrt(max(radius**2 - chord**2 / 4, 0.0))
    # A positive radius is the shorter arc: its center is right of the chord if it is clockwise.
    side = (-1.0 if is_clockwise else 1.0) * (1.0 if radius > 0 else -1.0)
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    return middle[0] - side * rise * dy / chord, middle[1] + side * rise * dx / chord
