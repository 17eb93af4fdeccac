"""Cords as they stand in `layout.json` and `study.json`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.curve import Hermite, Plane
from ...core.device import Sensor


def write_sensor(sensor: Sensor) -> dict[str, Any]:
    """Name, plane and path."""
    return {
        "name": sensor.name,
        "plane": {
            "origin": sensor.plane.origin.tolist(),
            "normal": sensor.plane.normal.tolist(),
            "x_axis": sensor.plane.axes[:, 0].tolist(),
        },
        "control_points": sensor.curve.points.tolist(),
        "tangents": sensor.curve.tangents.tolist(),
    }


def read_sensor(data: dict[str, Any]) -> Sensor:
    """The cord that `write_sensor` wrote."""
    p = data["plane"]
    plane = Plane.from_normal(*(np.array(p[k]) for k in ("origin", "normal", "x_axis")))
    curve = Hermite(np.array(data["control_points"]), np.array(data["tangents"]))
    return Sensor(data["name"], plane, curve)
