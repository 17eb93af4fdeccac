"""Place a cord at given parameters, and differentiate its samples and limits by them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane
from ...core.device.device import Sensor
from ...core.machine import kernels
from .cord_parameters import FRAME_SIZE, CordParameters


@dataclass(frozen=True, slots=True)
class PlacedCord:
    """A cord at given parameters.

    Attributes:
        cord: The parameters' definition.
        stack: (2 k, d) mm, control points above tangents; d is 2 in a plane and 3 in space.
        points: (p, 3) mm, samples of the path in the rest frame.
        local: (p, d) mm, the same samples in the plane or frame, relative to the pivot.
        pivot: (3,) mm, the point that the plane turns about.
        axes: (3, 3), axes of the plane in columns.
        turns: (t, 3, 3), derivatives of the axes by the turns; t = 3, or 0 for a fixed plane.
    """

    cord: CordParameters
    stack: Float
    points: Float
    local: Float
    pivot: Float
    axes: Float
    turns: Float

    def sensor(self) -> Sensor:
        """Return the sensor at these parameters."""
        cord, k = self.cord, len(self.stack) // 2
        plane = cord.sensor.plane
        if cord.has_plane:
            plane = Plane(self.pivot - self.axes[:, :2] @ cord.center, self.axes)
        return replace(cord.sensor, plane=plane, curve=Hermite(self.stack[:k], self.stack[k:]))

    @property
    def motion(self) -> tuple[Float, Float, Float, Float, Float]:
        """How the samples follow the parameters, as compiled loops take it."""
        return self.cord.basis_of_rows, self.local, self.axes, self.turns, self.cord.moves

    def pull(self, by_points: Float) -> Float:
        """Return derivatives (size, s) by the parameters from those by the points (p, 3, s)."""
        out = np.zeros((self.cord.size, by_points.shape[2]))
        kernels.pull_points(self.motion, by_points, out)
        return out

    def pull_one(self, by_points: Float) -> Float:
        """Return the derivatives (size,) of one value from those by the points (p, 3)."""
        return np.asarray(self.pull(by_points[:, :, None])[:, 0])

    def height(self, point: Float) -> tuple[float, Float]:
        """Return the height of a point (3,) mm above the plane, mm, and its derivative (size,)."""
        by = np.zeros(self.cord.size)
        if self.cord.has_plane:
            by[-FRAME_SIZE:-3] = -self.cord.moves @ self.axes[:, 2]
            by[-3:] = self.turns[:, :, 2] @ (point - self.pivot)
        return float((point - self.pivot) @ self.axes[:, 2]), by

    def turning(self, radius: float) -> tuple[Float, Float]:
        """Return the margins of the path's curvature and speed at q samples.

        The margin of curvature is 1 - radius |curvature|; that of the speed is its ratio to the
        smallest speed allowed, minus one. Where the speed vanishes the path has a cusp and no
        curvature.

        Args:
            radius: Smallest radius of curvature, mm.

        Returns:
            Margins (2 q,), curvature first, and their derivatives (2 q, size).
        """
        cord, k = self.cord, len(self.cord.first)
        d, dd = cord.first @ self.stack, cord.second @ self.stack
        least = cord.least_speed
        speed = np.linalg.norm(d, axis=1)
        scale = np.maximum(speed, least)
        bend, by_first, by_second = _bending(d, dd)
        turn = radius / scale**3
        value = np.concatenate([1 - turn * bend, speed / least - 1])
        f, s = cord.first[:, cord.rows], cord.second[:, cord.rows]
        derivative = np.zeros((2 * k, cord.size))
        dimensions = d.shape[1]
        inside = derivative[:, : dimensions * len(cord.rows)]
        # Derivative by the square of the speed.
        grown = np.where(speed > least, 3 * turn * bend / scale**2, 0.0)
        for axis in range(dimensions):
            by_bend = by_first[:, axis, None] * f + by_second[:, axis, None] * s
            by_square = d[:, axis, None] * f
            inside[:k, axis::dimensions] = grown[:, None] * by_square - turn[:, None] * by_bend
            inside[k:, axis::dimensions] = by_square / np.maximum(speed * least, 1e-9)[:, None]
        return value, derivative


def _bending(d: Float, dd: Float) -> tuple[Float, Float, Float]:
    """Return |d x dd| of first and second derivatives (q, 2 or 3), and its derivatives by both."""
    if d.shape[1] == 2:
        cross = d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]
        sign = np.where(cross < 0, -1.0, 1.0)[:, None]
        by_first = sign * np.stack([dd[:, 1], -dd[:, 0]], axis=1)
        by_second = sign * np.stack([-d[:, 1], d[:, 0]], axis=1)
        return np.abs(cross), by_first, by_second
    cross = np.cross(d, dd)
    size = np.linalg.norm(cross, axis=1)
    unit = cross / np.maximum(size, 1e-12)[:, None]
    return size, np.cross(dd, unit), np.cross(unit, d)


def place_cord(cord: CordParameters, x: Float) -> PlacedCord:
    """Place a cord at parameters x (size,) mm."""
    stack, pivot, axes = cord.stack.copy(), cord.pivot.copy(), cord.sensor.plane.axes.copy()
    points, local = np.empty((len(cord.basis), 3)), np.empty((len(cord.basis), stack.shape[1]))
    turns = np.empty((3 if cord.has_plane else 0, 3, 3))
    kernels.place_cord(
        x, cord.rows, cord.basis, cord.center, cord.moves, cord.reach, stack, pivot, axes, turns,
        local, points,
    )  # fmt: skip
    return PlacedCord(cord, stack, points, local, pivot, axes, turns)
