"""Whether a region holds anything of a body, known from its surface alone."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere
from ...core.mesh import Surface

#: Points along each side of the box in which body and region may meet.
_SIDE = 24


def holds_body(shape: Shape, surface: Surface) -> bool:
    """Whether a corner or the middle of a triangle lies in the region, or a point of a grid inside
    the region lies in the body. A corner of a region that only just reaches in may be missed."""
    corners = surface.vertices[surface.faces]
    if shape.contains(corners.reshape(-1, 3)).any() or shape.contains(corners.mean(1)).any():
        return True
    low, high = surface.bounds
    least, most = bounds(shape)
    low, high = np.maximum(low, least), np.minimum(high, most)
    if (low > high).any():
        return False
    axes = np.linspace(low, high, _SIDE).T
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[shape.contains(points)]
    if not len(points):
        return False
    import igl

    winding = igl.fast_winding_number(
        np.ascontiguousarray(surface.vertices), np.ascontiguousarray(surface.faces), points
    )
    return bool((np.asarray(winding) > 0.5).any())


def bounds(shape: Shape) -> tuple[Float, Float]:
    """Lowest and highest corner (3,) mm of a region; infinite where it has none."""
    if isinstance(shape, Box):
        return shape.low, shape.high
    if isinstance(shape, Sphere):
        return shape.center - shape.radius, shape.center + shape.radius
    if isinstance(shape, Cylinder):
        ends = np.array([shape.start, shape.end])
        return ends.min(0) - shape.radius, ends.max(0) + shape.radius
    return np.full(3, -np.inf), np.full(3, np.inf)


def where(shape: Shape) -> str:
    """The region's place in words."""
    if isinstance(shape, HalfSpace):
        return f"the half space from {_point(shape.origin)} on towards {_point(shape.normal)}"
    if isinstance(shape, Sphere):
        return f"the sphere of radius {shape.radius:.4g} mm around {_point(shape.center)}"
    if isinstance(shape, Cylinder):
        return (
            f"the cylinder of radius {shape.radius:.4g} mm from {_point(shape.start)} to"
            f" {_point(shape.end)}"
        )
    return f"the box from {_point(shape.low)} to {_point(shape.high)}"


def place(surface: Surface) -> str:
    """Where a body lies, in words."""
    low, high = surface.bounds
    return f"from {_point(low)} to {_point(high)} mm"


def _point(p: Float) -> str:
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in np.round(p, 6)) + ")"
