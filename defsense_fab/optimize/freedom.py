"""The free parameters of a cord and how its path follows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.arrays import Float
from ..core.curve import Hermite, Plane, hermite_basis
from ..core.device import Sensor

#: A path is sampled with at least this many points for signals and in `layout.json`.
SAMPLES = 120


def per_span(sensor: Sensor) -> int:
    return int(np.ceil(SAMPLES / (len(sensor.curve.points) - 1)))


class CordFreedom:
    """Parameters of one sensor, all in mm: interior control points, tangents, and the plane.

    The first and last two control points and the end tangents stay in the plane. The plane
    moves along its normal and tilts about the path's middle; a tilt counts as the movement
    it causes at half the path's extent.
    """

    def __init__(self, sensor: Sensor) -> None:
        self.sensor = sensor
        k = len(sensor.curve.points)
        self._stack = np.concatenate([sensor.curve.points, sensor.curve.tangents])
        rows = [*range(2, k - 2), *range(k + 1, 2 * k - 1)] if "path" in sensor.free else []
        self._rows = np.array(rows, int)
        self._plane = "plane" in sensor.free
        self.size = 2 * len(rows) + 3 * self._plane
        self.center = (sensor.curve.points.min(0) + sensor.curve.points.max(0)) / 2
        self.reach = float(np.linalg.norm(np.ptp(sensor.curve.points, axis=0))) / 2
        self._per_span = per_span(sensor)
        self._basis = hermite_basis(k, self._per_span)[0]
        _, self._first, self._second = hermite_basis(k, 8)

    def _stacked(self, x: Float) -> Float:
        stack = self._stack.copy()
        if len(self._rows):
            stack[self._rows] += x[: 2 * len(self._rows)].reshape(-1, 2)
        return stack

    def _frame(self, x: Float) -> tuple[Float, Float, list[Float]]:
        """Pivot (3,), axes (3, 3), and the axes' derivatives by the two tilts."""
        plane = self.sensor.plane
        pivot = plane.to_world(self.center)
        if not self._plane:
            return pivot, plane.axes, []
        offset, a, b = x[-3], x[-2] / self.reach, x[-1] / self.reach
        ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
        rx, drx = (
            np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]]),
            np.array([[0, 0, 0], [0, -sa, -ca], [0, ca, -sa]]),
        )
        ry, dry = (
            np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]]),
            np.array([[-sb, 0, cb], [0, 0, 0], [-cb, 0, -sb]]),
        )
        derivatives = [plane.axes @ drx @ ry / self.reach, plane.axes @ rx @ dry / self.reach]
        return pivot + offset * plane.normal, plane.axes @ rx @ ry, derivatives

    def apply(self, x: Float) -> Sensor:
        """The sensor at parameters x (size,)."""
        stack, k = self._stacked(x), len(self.sensor.curve.points)
        pivot, axes, _ = self._frame(x)
        plane = Plane(pivot - axes[:, :2] @ self.center, axes)
        return replace(self.sensor, plane=plane, curve=Hermite(stack[:k], stack[k:]))

    def path(self, x: Float) -> tuple[Float, Float]:
        """Sampled path (p, 3) in the rest frame and its derivative (p, 3, size)."""
        stack = self._stacked(x)
        pivot, axes, tilts = self._frame(x)
        local = self._basis @ stack - self.center
        derivative = np.zeros((len(local), 3, self.size))
        for i, row in enumerate(self._rows):
            for d in range(2):
                derivative[:, :, 2 * i + d] = self._basis[:, row, None] * axes[:, d]
        if self._plane:
            derivative[:, :, -3] = self.sensor.plane.normal
            for column, tilt in zip((-2, -1), tilts, strict=True):
                derivative[:, :, column] = local @ tilt[:, :2].T
        return pivot + local @ axes[:, :2].T, derivative

    def curvature(self, x: Float) -> tuple[Float, Float]:
        """Signed curvature (q,) in 1/mm at span ends and inside, and derivative (q, size)."""
        stack = self._stacked(x)
        d, dd = self._first @ stack, self._second @ stack
        speed = np.maximum(np.linalg.norm(d, axis=1), 1e-9)
        cross = d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]
        kappa = cross / speed**3
        derivative = np.zeros((len(kappa), self.size))
        for i, row in enumerate(self._rows):
            f, s = self._first[:, row], self._second[:, row]
            for axis, by_cross in enumerate(
                (f * dd[:, 1] - d[:, 1] * s, d[:, 0] * s - f * dd[:, 0])
            ):
                derivative[:, 2 * i + axis] = (
                    by_cross / speed**3 - 3 * kappa * f * d[:, axis] / speed**2
                )
        return kappa, derivative
