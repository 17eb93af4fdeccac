"""Layouts to the digits that they are told to: processors differ in those behind them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.curves.curve import Hermite, Plane
from ...core.device.device import Sensor
from ..search.starting_layouts import Layout

#: Decimals of lengths in mm, and of directions: far finer than any printer, far coarser than what
#: is left of rounding where a search has come to the same layout.
_LENGTHS, _DIRECTIONS = 4, 6


def as_told(layout: Layout) -> Layout:
    """The layout with what is free of each cord rounded; what was given stays as it is."""
    return tuple(_rounded(s) for s in layout)


def _rounded(sensor: Sensor) -> Sensor:
    curve, plane = sensor.curve, sensor.plane
    if "path" in sensor.free:
        curve = Hermite(_told(curve.points, _LENGTHS), _told(curve.tangents, _LENGTHS))
    origin = _told(plane.origin, _LENGTHS)
    if "plane" in sensor.free:
        normal, x_axis = (_told(v, _DIRECTIONS) for v in (plane.normal, plane.axes[:, 0]))
        plane = Plane.from_normal(origin, normal, x_axis)
    elif "offset" in sensor.free:
        plane = Plane(origin, plane.axes)
    return replace(sensor, curve=curve, plane=plane)


def _told(values: Float, decimals: int) -> Float:
    return np.round(values, decimals) + 0.0  # no negative zeros
