"""Find whether a region holds any of a body, from the body's surface alone, and describe
regions.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere, hull_points, inset
from ...core.mesh import Surface
from ..kernels.surface_queries import signed_distance_of
from .repair.findings import describe_point

#: Distance of points that stand for regions which pins and wires avoid, mm.
KEPT_SPACING_MM = 2.0
#: Distance by which mouths may be outside of the regions of exits, mm.
EXIT_TOLERANCE_MM = 0.2
_SKIN_SAMPLES = 40_000  # of the triangles that a region may meet
#: Grid points along each side of the box in which body and region may meet.
GRID_POINTS = 24


def holds_body(shape: Shape, surface: Surface) -> bool:
    """Return whether a region holds a part of a body.

    A corner or center of a triangle lies in the region, or a point of a grid inside the region lies
    in the body. A region that only just reaches into the body may be missed.

    Args:
        shape: The region.
        surface: Surface of the body.
    """
    corners = surface.vertices[surface.faces]
    if shape.contains(corners.reshape(-1, 3)).any() or shape.contains(corners.mean(1)).any():
        return True
    low, high = surface.bounds
    region_low, region_high = region_bounds(shape)
    low, high = np.maximum(low, region_low), np.minimum(high, region_high)
    if (low > high).any():
        return False
    axes = np.linspace(low, high, GRID_POINTS).T
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[shape.contains(points)]
    return bool(signed_distance_of(surface).inside(points).any()) if len(points) else False


def sample_skin(shape: Shape, surface: Surface) -> Float:
    """Return points (n, 3) mm of a body's skin in a region, evenly spread; none without skin.

    Args:
        shape: The region, which counts as slightly larger, so that it may end at the skin.
        surface: Surface of the body.
    """
    low, high = region_bounds(shape)
    corners = surface.vertices[surface.faces]
    is_near = (corners.max(1) > low - EXIT_TOLERANCE_MM) & (
        corners.min(1) < high + EXIT_TOLERANCE_MM
    )
    faces = surface.faces[is_near.all(axis=1)]
    if not len(faces):
        return np.zeros((0, 3))
    nearby = Surface(surface.vertices, faces)
    points = nearby.scatter(_SKIN_SAMPLES, np.random.default_rng(0))
    return np.asarray(points[inset(shape, points)[0] > -EXIT_TOLERANCE_MM])


def region_bounds(shape: Shape) -> tuple[Float, Float]:
    """Return the lowest and highest corner (3,), mm, of a region; infinite where it has no end."""
    if isinstance(shape, Box):
        return shape.low, shape.high
    if isinstance(shape, Sphere):
        return shape.center - shape.radius, shape.center + shape.radius
    if isinstance(shape, Cylinder):
        ends = np.array([shape.start, shape.end])
        return ends.min(0) - shape.radius, ends.max(0) + shape.radius
    return np.full(3, -np.inf), np.full(3, np.inf)


def fill_region(shape: Shape, spacing: float) -> Float:
    """Return points (n, 3) mm of a grid in a bounded region, at least one.

    Args:
        shape: A box, ball or cylinder.
        spacing: Distance of neighbors, mm.
    """
    corners = hull_points(shape)
    bounds = zip(corners.min(axis=0), corners.max(axis=0), strict=True)
    axes = [np.arange(low, high + spacing, spacing) for low, high in bounds]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = points[shape.contains(points)]
    return inside if len(inside) else corners.mean(axis=0, keepdims=True)


def describe_region(shape: Shape) -> str:
    """Describe the place of a region, as a noun phrase."""
    if isinstance(shape, HalfSpace):
        return (
            f"the half space from {describe_point(shape.origin)} on towards"
            f" {describe_point(shape.normal)}"
        )
    if isinstance(shape, Sphere):
        return f"the sphere of radius {shape.radius:.4g} mm around {describe_point(shape.center)}"
    if isinstance(shape, Cylinder):
        return (
            f"the cylinder of radius {shape.radius:.4g} mm from {describe_point(shape.start)} to"
            f" {describe_point(shape.end)}"
        )
    return f"the box from {describe_point(shape.low)} to {describe_point(shape.high)}"


def describe_extent(surface: Surface) -> str:
    """Describe where a body lies, as "from (x, y, z) to (x, y, z) mm"."""
    low, high = surface.bounds
    return f"from {describe_point(low)} to {describe_point(high)} mm"
