"""Shapes of the named regions of a body, in the rest frame (mm)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float


@dataclass(frozen=True)
class Box:
    """Axis-aligned box.

    Attributes:
        low: Lowest corner (3,), mm.
        high: Highest corner (3,), mm.
    """

    low: Float
    high: Float

    def contains(self, points: Float) -> Bool:
        """Return whether points (..., 3) are in the box (...)."""
        return np.asarray(((points >= self.low) & (points <= self.high)).all(axis=-1))


@dataclass(frozen=True)
class Sphere:
    """Solid sphere.

    Attributes:
        center: Center (3,), mm.
        radius: Radius, mm.
    """

    center: Float
    radius: float

    def contains(self, points: Float) -> Bool:
        """Return whether points (..., 3) are in the sphere (...)."""
        return np.asarray(np.linalg.norm(points - self.center, axis=-1) <= self.radius)


@dataclass(frozen=True)
class HalfSpace:
    """All points on one side of a plane.

    Attributes:
        origin: Point (3,) of the plane, mm.
        normal: Vector (3,) to the side of the half-space, of any length.
    """

    origin: Float
    normal: Float

    def contains(self, points: Float) -> Bool:
        """Return whether points (..., 3) are in the half-space (...)."""
        return np.asarray((points - self.origin) @ self.normal >= 0)


@dataclass(frozen=True)
class Cylinder:
    """Solid cylinder.

    Attributes:
        start: Start of its axis (3,), mm.
        end: End of its axis (3,), mm.
        radius: Radius, mm.
    """

    start: Float
    end: Float
    radius: float

    def contains(self, points: Float) -> Bool:
        """Return whether points (..., 3) are in the cylinder (...)."""
        axis = self.end - self.start
        height = float(np.linalg.norm(axis))
        axis = axis / height
        along = (points - self.start) @ axis
        across = np.linalg.norm(points - self.start - along[..., None] * axis, axis=-1)
        return np.asarray((along >= 0) & (along <= height) & (across <= self.radius))


Shape = Box | Sphere | HalfSpace | Cylinder


_CIRCLE_POINTS = 24


def hull_points(shape: Shape) -> Float:
    """Return points (n, 3) mm whose convex hull holds a shape that is bounded.

    Raises:
        ValueError: The shape is a half-space.
    """
    if isinstance(shape, Box):
        corners = np.array(np.meshgrid(*np.stack([shape.low, shape.high]).T)).reshape(3, -1)
        return np.asarray(corners.T)
    angle = np.arange(_CIRCLE_POINTS) * 2 * np.pi / _CIRCLE_POINTS
    widening = 1 / np.cos(np.pi / _CIRCLE_POINTS)  # so that polygons hold their circles
    if isinstance(shape, Sphere):
        cube = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
        return np.asarray(shape.center + shape.radius * cube)
    if isinstance(shape, Cylinder):
        axis = (shape.end - shape.start) / np.linalg.norm(shape.end - shape.start)
        u = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        u /= np.linalg.norm(u)
        ring = np.outer(np.cos(angle), u) + np.outer(np.sin(angle), np.cross(axis, u))
        ring = shape.radius * widening * ring
        return np.concatenate([shape.start + ring, shape.end + ring])
    raise ValueError("a half-space has no bounds")


def inset(shape: Shape, points: Float) -> tuple[Float, Float]:
    """Return how far points are inside a shape, with the sign of being inside.

    Outside of an edge or corner it is the largest distance beyond one face.

    Args:
        shape: The shape.
        points: Points (n, 3), mm.

    Returns:
        Distances (n,) mm, negative outside, and their gradients (n, 3), unit vectors.
    """
    if isinstance(shape, Sphere):
        away = points - shape.center
        distance = np.linalg.norm(away, axis=1)
        return shape.radius - distance, -away / np.maximum(distance, 1e-12)[:, None]
    if isinstance(shape, HalfSpace):
        normal = shape.normal / np.linalg.norm(shape.normal)
        return (points - shape.origin) @ normal, np.broadcast_to(normal, points.shape)
    if isinstance(shape, Cylinder):
        axis = shape.end - shape.start
        height = float(np.linalg.norm(axis))
        axis = axis / height
        along = (points - shape.start) @ axis
        across = points - shape.start - along[:, None] * axis
        size = np.linalg.norm(across, axis=1)
        rooms = np.stack([along, height - along, shape.radius - size], axis=1)
        unit = -across / np.maximum(size, 1e-12)[:, None]
        ends = np.broadcast_to(axis, points.shape)
        normals = np.stack([ends, -ends, unit], axis=1)
    else:
        rooms = np.concatenate([points - shape.low, shape.high - points], axis=1)
        normals = np.broadcast_to(np.concatenate([np.eye(3), -np.eye(3)]), (len(points), 6, 3))
    nearest, row = rooms.argmin(axis=1), np.arange(len(points))
    return rooms[row, nearest], normals[row, nearest]


def shape_problem(shape: Shape) -> tuple[str, str] | None:
    """Return why a shape is empty.

    Args:
        shape: A shape with finite numbers.

    Returns:
        The key of `device.toml` that is wrong and what is wrong with it; None for a valid shape.
    """
    if isinstance(shape, Box) and (shape.low >= shape.high).any():
        return "box", "the first corner must be lower than the second in x, y and z"
    if isinstance(shape, HalfSpace) and not shape.normal.any():
        return "normal", "must not be zero"
    if isinstance(shape, Cylinder) and np.allclose(shape.start, shape.end):
        return "end", "must differ from start"
    return None
