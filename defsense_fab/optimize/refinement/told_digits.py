"""Layouts to the digits that they are told to: processors differ in those behind them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane
from ...core.device.device import PLANE_FREEDOMS, Sensor
from ..problem.cord_parameters import freedom, in_frame
from ..search.starting_layouts import Layout

#: Decimals of lengths in mm, and of directions: far finer than any printer, far coarser than what
#: is left of rounding where a search has come to the same layout.
_LENGTHS, _DIRECTIONS = 4, 6


def as_told(layout: Layout) -> Layout:
    """The layout with what is free of each cord rounded; what was given stays where it is, and
    cords in one plane that is free stay in it, in the frame of the first of them."""
    out: list[Sensor] = []
    for sensor, lead in zip(layout, _leads(layout), strict=True):
        free = freedom(sensor, layout)
        if free & PLANE_FREEDOMS and not _same_frame(sensor.plane, lead.plane):
            sensor = in_frame(sensor, lead.plane)
        out.append(_rounded(sensor, free))
    return tuple(out)


def _leads(layout: Layout) -> list[Sensor]:
    """Of each cord the first one in its plane."""
    return [next(s for s in layout if s.plane.coincides(sensor.plane)) for sensor in layout]


def _same_frame(a: Plane, b: Plane) -> bool:
    return np.array_equal(a.origin, b.origin) and np.array_equal(a.axes, b.axes)


def _rounded(sensor: Sensor, free: frozenset[str]) -> Sensor:
    curve, plane = sensor.curve, sensor.plane
    if "path" in free:
        curve = Hermite(_told(curve.points, _LENGTHS), _told(curve.tangents, _LENGTHS))
    origin = _told(plane.origin, _LENGTHS)
    if "plane" in free:
        normal, x_axis = (_told(v, _DIRECTIONS) for v in (plane.normal, plane.axes[:, 0]))
        plane = Plane.from_normal(origin, normal, x_axis)
    elif "offset" in free:
        plane = Plane(origin, plane.axes)
    return replace(sensor, curve=curve, plane=plane)


def _told(values: Float, decimals: int) -> Float:
    return np.round(values, decimals) + 0.0  # no negative zeros
