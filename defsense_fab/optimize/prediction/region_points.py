"""Which points of a body's surface regions hold, and boxes about points that were chosen."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from ...core.arrays import Bool, Float
from ...core.device.regions import Box, Shape

_FEWEST = 3  # points by which a region holds or moves a body
_STEPS = 100  # of a body's size, to which corners are rounded


def fitted_box(points: Float, size: float) -> Box:
    """About points (k, 3) mm of a body of a `size` mm; its corners are rounded outwards, as a
    person would write them. Raises ValueError without points."""
    if not len(points):
        raise ValueError("no points to fit a box to")
    step = 10.0 ** np.floor(np.log10(size / _STEPS))
    low = np.floor(points.min(axis=0) / step - 0.1) * step
    high = np.ceil(points.max(axis=0) / step + 0.1) * step
    return Box(np.round(low, 6) + 0.0, np.round(high, 6) + 0.0)


def held_points(regions: Mapping[str, Shape], points: Float) -> dict[str, Bool]:
    """Which of the points (v, 3) mm each region holds, (v,)."""
    return {name: shape.contains(points) for name, shape in regions.items()}


def region_problems(held: Mapping[str, Bool]) -> dict[str, list[str]]:
    """By region: what is wrong with the surface points (v,) that regions hold, and what to do; only
    regions with which something is."""
    out: dict[str, list[str]] = {}
    for name, inside in held.items():
        count = int(inside.sum())
        if count == 0:
            out[name] = [f"`{name}` holds no surface point: move or enlarge it."]
        elif count < _FEWEST:
            points = "point" if count == 1 else "points"
            out[name] = [
                f"`{name}` holds {count} surface {points}, too few to hold the body by: enlarge it."
            ]
    for a, b in combinations(held, 2):
        both = int((held[a] & held[b]).sum())
        if both:
            points = "point" if both == 1 else "points"
            told = (
                f"`{a}` and `{b}` share {both} {points}: no pose can hold one and move the other;"
                " make one smaller."
            )
            out.setdefault(a, []).append(told)
            out.setdefault(b, []).append(told)
    return out
