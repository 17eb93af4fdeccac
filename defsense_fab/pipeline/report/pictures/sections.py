"""Where a body is cut to see its strain: through what moves and where it is strained most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....core.arrays import Bool, Float

_STRAINED = 98.0  # per cent of the nodes that are strained less than where it is much
_ASIDE = 0.2  # of the largest movement: less than this to the side is none
_SHORT = 0.1  # of the body's size: nearer points give no direction
_NEAR = 0.02  # of the body's size: so far a plane may be moved to be parallel to the axes


@dataclass(frozen=True)
class Sections:
    """Two planes through the point `origin` (3,) mm in the body at rest: that with the normal
    `main` (3,), in which the body moves, and that with the normal `second` (3,), square to it;
    where the largest strain is (3,) mm, and how far from the main plane, mm."""

    origin: Float
    main: Float
    second: Float
    peak: Float
    off: float


def sections(rest: Float, moved: Float, strain: Float, held: Bool) -> Sections:
    """For nodes (n, 3) mm at `rest`, their displacements `moved` (n, 3) mm, and largest principal
    strain (n,); the nodes (n,) that are `held` by handles, or none.

    The planes hold the line from where the strain is large to the middle of what moves, and the
    main one the direction in which that moves; where it only turns or is drawn along that line,
    the place of the largest strain instead."""
    size = float(np.linalg.norm(np.ptp(rest, axis=0)))
    way = np.linalg.norm(moved, axis=1)
    some = held if held.any() else way >= np.percentile(way, 95)
    handle, movement = rest[some].mean(0), moved[some].mean(0)
    peak = rest[strain.argmax()]
    much = strain >= np.percentile(strain, _STRAINED)
    strained = np.average(rest[much], axis=0, weights=np.maximum(strain[much], 1e-12))
    along = handle - strained
    if np.linalg.norm(along) < _SHORT * size:
        along = _longest(rest)
    along = along / np.linalg.norm(along)
    aside = movement - (movement @ along) * along
    if np.linalg.norm(aside) < _ASIDE * way.max():
        off = peak - handle
        aside = off - (off @ along) * along
    if np.linalg.norm(aside) < 1e-6 * size:
        aside = np.eye(3)[np.abs(along).argmin()]
    main = np.cross(along, aside)
    main, origin = _squared(main / np.linalg.norm(main), handle, strained, _NEAR * size)
    second = np.cross(main, along)
    second, other = _squared(second / np.linalg.norm(second), handle, strained, _NEAR * size)
    if abs(main @ second) > 1e-6:  # one was made parallel to the axes, the other not
        second = second - (second @ main) * main
        second = second / np.linalg.norm(second)
    origin = origin + ((other - origin) @ second) * second
    return Sections(origin, main, second, peak, float(abs((peak - origin) @ main)))


def _squared(normal: Float, one: Float, other: Float, near: float) -> tuple[Float, Float]:
    """A plane through two points: along an axis where it then misses both by little, with a point
    of it."""
    axis = np.eye(3)[np.abs(normal).argmax()] * np.sign(normal[np.abs(normal).argmax()])
    middle = (one + other) / 2
    if abs(axis @ (one - other)) / 2 <= near and axis @ normal > np.cos(np.radians(20)):
        return axis, middle
    return normal, middle


def _longest(points: Float) -> Float:
    """The direction in which points (n, 3) are spread most."""
    return np.asarray(np.linalg.svd(points - points.mean(0), full_matrices=False)[2][0])
