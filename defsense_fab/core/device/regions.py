"""Named parts of a body, by shape in rest coordinates (mm)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Bool, Float


@dataclass(frozen=True)
class Box:
    """Axis-aligned box from `low` to `high`, each (3,)."""

    low: Float
    high: Float

    def contains(self, points: Float) -> Bool:
        return np.asarray(((points >= self.low) & (points <= self.high)).all(axis=-1))


@dataclass(frozen=True)
class Sphere:
    """Ball around `center` (3,) of `radius`."""

    center: Float
    radius: float

    def contains(self, points: Float) -> Bool:
        return np.asarray(np.linalg.norm(points - self.center, axis=-1) <= self.radius)


@dataclass(frozen=True)
class HalfSpace:
    """All points on the side of the plane through `origin` that `normal` points to."""

    origin: Float
    normal: Float

    def contains(self, points: Float) -> Bool:
        return np.asarray((points - self.origin) @ self.normal >= 0)


@dataclass(frozen=True)
class Cylinder:
    """Solid cylinder of `radius` about the segment from `start` to `end`."""

    start: Float
    end: Float
    radius: float

    def contains(self, points: Float) -> Bool:
        axis = self.end - self.start
        height = float(np.linalg.norm(axis))
        axis = axis / height
        along = (points - self.start) @ axis
        across = np.linalg.norm(points - self.start - along[..., None] * axis, axis=-1)
        return np.asarray((along >= 0) & (along <= height) & (across <= self.radius))


Shape = Box | Sphere | HalfSpace | Cylinder


def flaw(shape: Shape) -> tuple[str, str] | None:
    """Why a shape of finite numbers holds no space, as the key that is wrong and a sentence; None
    of a shape that does."""
    if isinstance(shape, Box) and (shape.low >= shape.high).any():
        return "box", "the first corner must be lower than the second in x, y and z"
    if isinstance(shape, HalfSpace) and not shape.normal.any():
        return "normal", "must not be zero"
    if isinstance(shape, Cylinder) and np.allclose(shape.start, shape.end):
        return "end", "must differ from start"
    return None
