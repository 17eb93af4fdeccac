"""Named parts of a body, in mm in its rest frame, and as they stand in device.toml."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Float
from ..core.device.regions import Box, Cylinder, HalfSpace, Sphere
from ..core.errors import DeviceError


def box(low: ArrayLike, high: ArrayLike) -> Box:
    """The box between two corners (3,) mm, parallel to the axes. Raises DeviceError."""
    return Box(_point("low", low), _point("high", high))


def sphere(center: ArrayLike, radius: float) -> Sphere:
    """The ball of a radius (mm) around a point (3,) mm. Raises DeviceError."""
    return Sphere(_point("center", center), radius)


def half_space(origin: ArrayLike, normal: ArrayLike) -> HalfSpace:
    """What lies beyond the plane through `origin` (3,) mm, where `normal` (3,) points to. Raises
    DeviceError."""
    return HalfSpace(_point("origin", origin), _point("normal", normal))


def cylinder(start: ArrayLike, end: ArrayLike, radius: float) -> Cylinder:
    """The cylinder of a radius (mm) about the line between two points (3,) mm. Raises
    DeviceError."""
    return Cylinder(_point("start", start), _point("end", end), radius)


def region_table(name: str, shape: object) -> dict[str, Any]:
    """As in the table `[regions]`. Raises DeviceError for what is no shape."""
    if isinstance(shape, Box):
        return {"box": [shape.low.tolist(), shape.high.tolist()]}
    kinds: dict[type, str] = {Sphere: "sphere", HalfSpace: "half_space", Cylinder: "cylinder"}
    if type(shape) not in kinds:
        raise DeviceError(
            f"regions.{name}: is a {type(shape).__name__}; make it by box, sphere, half_space or"
            " cylinder"
        )
    return {kinds[type(shape)]: {k: np.asarray(v).tolist() for k, v in vars(shape).items()}}


def _point(name: str, values: ArrayLike) -> Float:
    try:
        point = np.asarray(values, float)
    except (TypeError, ValueError):
        raise DeviceError(f"{name}: must be 3 numbers, not {values!r}") from None
    if point.shape != (3,) or not np.isfinite(point).all():
        raise DeviceError(f"{name}: must be 3 finite numbers, not {values!r}")
    return point
