"""Cords drawn by hand."""

import numpy as np

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor


def cord(name, normal, origin, x_axis, points):
    """A cord through points (n, 2) of a plane, mm."""
    points = np.array(points, float)
    plane = Plane.from_normal(
        np.array(origin, float), np.array(normal, float), np.array(x_axis, float)
    )
    return Sensor(name, plane, Hermite(points, catmull_rom(points)))
