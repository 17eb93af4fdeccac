"""A cord of the bar that keeps all limits of its path and cannot be made with the cord `A`."""

import numpy as np

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor


def unmakeable_cord(name="crossing"):
    """Return the cord; its plane cuts a chip off the part next to the channel of `A`."""
    origin, normal = np.array([75.0, 4.68, -2.74]), np.array([0.062, 0.253, 0.965])
    plane = Plane.from_normal(origin, normal, np.array([1.0, 0.0, 0.0]))
    heights = [-6.5, -7.5, -0.8, -3.4, -8.9, 0.3, -2.3]
    points = np.stack([[-73.0, -50.0, -25.0, 0.0, 25.0, 50.0, 73.0], heights], axis=1)
    return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset({"path"}))
