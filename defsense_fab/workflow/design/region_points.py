"""Find the surface points that regions hold, and fit boxes about chosen points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...core.arrays import Bool, Float
from ...core.device.regions import Box, Shape

_MIN_POINTS = 3  # by which a region can hold or move a body
_ROUNDING_STEPS = 100  # of a body's size, to which corners are rounded


@dataclass(frozen=True)
class RegionProblem:
    """A defect of a region, or of two regions together.

    Attributes:
        code: `"region-without-points"`, `"region-too-few-points"` or `"regions-share-points"`.
        message: The defect and its remedy, in Markdown.
        regions: Names of the regions.
        count: Number of surface points concerned.
    """

    code: str
    message: str
    regions: tuple[str, ...]
    count: int

    def __str__(self) -> str:
        return self.message


def fit_box(points: Float, size: float) -> Box:
    """Fit a box about points, with corners rounded outward as a person would write them.

    Args:
        points: Points (k, 3) mm.
        size: Size of the body, mm.

    Raises:
        ValueError: If there are no points.
    """
    if not len(points):
        raise ValueError("no points to fit a box to")
    step = 10.0 ** np.floor(np.log10(size / _ROUNDING_STEPS))
    low = np.floor(points.min(axis=0) / step - 0.1) * step
    high = np.ceil(points.max(axis=0) / step + 0.1) * step
    return Box(np.round(low, 6) + 0.0, np.round(high, 6) + 0.0)


def points_in_regions(regions: Mapping[str, Shape], points: Float) -> dict[str, Bool]:
    """Return for each region which of the points (v, 3) mm it holds, (v,)."""
    return {name: shape.contains(points) for name, shape in regions.items()}


def find_region_problems(held: Mapping[str, Bool]) -> dict[str, list[RegionProblem]]:
    """Find regions that hold too few surface points, and regions that share points.

    Args:
        held: For each region, which of the surface points (v,) it holds.

    Returns:
        The problems of each region that has any.
    """
    out: dict[str, list[RegionProblem]] = {}
    for name, inside in held.items():
        count = int(inside.sum())
        if count == 0:
            message = f"`{name}` holds no surface point: move or enlarge it."
            out[name] = [RegionProblem("region-without-points", message, (name,), 0)]
        elif count < _MIN_POINTS:
            points = "point" if count == 1 else "points"
            message = (
                f"`{name}` holds {count} surface {points}, too few to hold the body: enlarge it."
            )
            out[name] = [RegionProblem("region-too-few-points", message, (name,), count)]
    for a, b in combinations(held, 2):
        count = int((held[a] & held[b]).sum())
        if count:
            points = "point" if count == 1 else "points"
            message = (
                f"`{a}` and `{b}` share {count} {points}: no pose can hold one and move the other."
                " Make one smaller."
            )
            problem = RegionProblem("regions-share-points", message, (a, b), count)
            out.setdefault(a, []).append(problem)
            out.setdefault(b, []).append(problem)
    return out
