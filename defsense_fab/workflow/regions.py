"""Named parts of a body, in mm in its rest frame, and as they stand in device.toml."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Float
from ..core.device.regions import Box, Cylinder, HalfSpace, Shape, Sphere, shape_problem
from ..core.errors import DeviceError
from .given import array, number, shown

S = TypeVar("S", bound=Shape)


def box(low: ArrayLike, high: ArrayLike) -> Box:
    """The box between two corners (3,) mm, parallel to the axes, the first of which is lower than
    the second in x, y and z. Raises DeviceError."""
    return _checked(Box(_point("low", low), _point("high", high)))


def sphere(center: ArrayLike, radius: float) -> Sphere:
    """The ball of a radius (mm) above 0 around a point (3,) mm. Raises DeviceError."""
    return Sphere(_point("center", center), number(radius, "radius", above=0))


def half_space(origin: ArrayLike, normal: ArrayLike) -> HalfSpace:
    """What lies beyond the plane through `origin` (3,) mm, where `normal` (3,) points to, of any
    length above 0. Raises DeviceError."""
    return _checked(HalfSpace(_point("origin", origin), _point("normal", normal)))


def cylinder(start: ArrayLike, end: ArrayLike, radius: float) -> Cylinder:
    """The cylinder of a radius (mm) above 0 about the line between two points (3,) mm that differ.
    Raises DeviceError."""
    ends = _point("start", start), _point("end", end)
    return _checked(Cylinder(*ends, number(radius, "radius", above=0)))


def region_tables(regions: object) -> dict[str, Any]:
    """As in the table `[regions]`. Raises DeviceError for what are no shapes by name."""
    if not isinstance(regions, Mapping):
        raise DeviceError(
            f'regions: must be a dict of shapes by name, as in {{"base": box(low, high)}}, not'
            f" {shown(regions)}"
        )
    for name in regions:
        if not isinstance(name, str) or not name.strip():
            raise DeviceError(f"regions: names must be text that is not empty, not {shown(name)}")
    return {name: _table(name, shape) for name, shape in regions.items()}


def _table(name: str, shape: object) -> dict[str, Any]:
    if isinstance(shape, Box):
        return {"box": [shape.low.tolist(), shape.high.tolist()]}
    kinds: dict[type, str] = {Sphere: "sphere", HalfSpace: "half_space", Cylinder: "cylinder"}
    if type(shape) not in kinds:
        raise DeviceError(
            f"regions.{name}: must be made by box, sphere, half_space or cylinder, not"
            f" {shown(shape)}"
        )
    return {kinds[type(shape)]: {k: np.asarray(v).tolist() for k, v in vars(shape).items()}}


def _checked(shape: S) -> S:
    if wrong := shape_problem(shape):
        raise DeviceError(": ".join(wrong))
    return shape


def _point(name: str, values: ArrayLike) -> Float:
    point = array(values, name)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise DeviceError(f"{name}: must be 3 finite numbers, not {values!r}")
    return point
