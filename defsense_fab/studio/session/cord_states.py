"""The device's cords as the page gets them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane, is_smooth, sample_path
from ...core.device.device import FREEDOMS, Sensor
from ...core.errors import LayoutError
from ..messages.shell import CordState


def cord_state(sensor: Sensor, color: str) -> CordState:
    """Return a cord as the page gets it."""
    plane = sensor.plane
    return CordState(
        name=sensor.name,
        color=color,
        is_planar=sensor.curve.is_planar,
        origin=rounded(plane.origin),
        axes=plane.axes.T.tolist(),
        points=rounded(sensor.curve.points),
        tangents=rounded(sensor.curve.tangents),
        is_smooth=is_smooth(sensor.curve),
        path=path_points(sensor),
        free=[word for word in FREEDOMS if word in sensor.free],
    )


def cord_states(sensors: Sequence[Sensor], colors: Mapping[str, str]) -> list[CordState]:
    """Return cords as the page gets them, with their colors by name."""
    return [cord_state(sensor, colors[sensor.name]) for sensor in sensors]


def path_points(sensor: Sensor) -> list[list[float]]:
    """Return points (p, 3) mm along a cord's path."""
    return rounded(sample_path(sensor))


def plane_of(origin: Sequence[float], axes: Sequence[Sequence[float]]) -> Plane:
    """Return the plane with an origin (3,) mm, and its x axis, y axis and normal by rows (3, 3).

    Raises:
        LayoutError: They define no plane.
    """
    if [len(values) for values in (origin, axes, *axes)] != [3] * 5:
        raise _invalid_plane("its origin needs three numbers, and its axes nine")
    point, rows = np.asarray(origin, float), np.asarray(axes, float)
    try:
        return Plane.from_normal(point, rows[2], rows[0])
    except ValueError as error:
        raise _invalid_plane(str(error)) from None


def rounded(values: Float) -> list:  # type: ignore[type-arg]  # nested as the array is
    """Return an array as lists of numbers with four decimals."""
    lists: list = np.round(np.asarray(values, float), 4).tolist()  # type: ignore[type-arg]
    return lists


def _invalid_plane(problem: str) -> LayoutError:
    return LayoutError(f"this is not a plane: {problem}", code="invalid-plane")
