"""Named parts of a body, in mm in its rest frame, and as they stand in device.toml."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.regions import Box, Cylinder, HalfSpace, Shape, Sphere


def box(low: ArrayLike, high: ArrayLike) -> Box:
    """The box between two corners (3,) mm, parallel to the axes."""
    return Box(np.asarray(low, float), np.asarray(high, float))


def sphere(center: ArrayLike, radius: float) -> Sphere:
    """The ball of a radius (mm) around a point (3,) mm."""
    return Sphere(np.asarray(center, float), radius)


def half_space(origin: ArrayLike, normal: ArrayLike) -> HalfSpace:
    """What lies beyond the plane through `origin` (3,) mm, where `normal` (3,) points to."""
    return HalfSpace(np.asarray(origin, float), np.asarray(normal, float))


def cylinder(start: ArrayLike, end: ArrayLike, radius: float) -> Cylinder:
    """The cylinder of a radius (mm) about the line between two points (3,) mm."""
    return Cylinder(np.asarray(start, float), np.asarray(end, float), radius)


def region_table(shape: Shape) -> dict[str, Any]:
    """As in the table `[regions]`."""
    if isinstance(shape, Box):
        return {"box": [shape.low.tolist(), shape.high.tolist()]}
    kind = {Sphere: "sphere", HalfSpace: "half_space", Cylinder: "cylinder"}[type(shape)]
    return {
        kind: {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(shape).items()}
    }
