"""The free parameters of a cord and how its path follows them."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np

from ..core.arrays import Float
from ..core.curve import Hermite, Plane, hermite_basis
from ..core.device import Sensor

#: A path is sampled with at least this many points for signals and in `layout.json`.
SAMPLES = 120


def per_span(sensor: Sensor) -> int:
    return int(np.ceil(SAMPLES / (len(sensor.curve.points) - 1)))


def sample_path(sensor: Sensor) -> Float:
    """The path's points (p, 3) in the rest frame, p > 100."""
    return sensor.plane.to_world(sensor.curve.sample(per_span(sensor)))


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
        self._pivot = sensor.plane.to_world(self.center)
        self.reach = float(np.linalg.norm(np.ptp(sensor.curve.points, axis=0))) / 2
        self._per_span = per_span(sensor)
        self._basis = hermite_basis(k, self._per_span)[0]
        self._basis_of_rows = self._basis[:, self._rows]
        _, self._first, self._second = hermite_basis(k, 8)

    def _stacked(self, x: Float) -> Float:
        stack = self._stack.copy()
        if len(self._rows):
            stack[self._rows] += x[: 2 * len(self._rows)].reshape(-1, 2)
        return stack

    def _frame(self, x: Float) -> tuple[Float, Float, Float]:
        """Pivot (3,), axes (3, 3), and the axes' derivatives (2, 3, 3) by the two tilts."""
        if not self._plane:
            return self._pivot, self.sensor.plane.axes, np.zeros((0, 3, 3))
        axes, tilts = _tilted(self.sensor.plane.axes, x[-2] / self.reach, x[-1] / self.reach)
        return self._pivot + x[-3] * self.sensor.plane.normal, axes, tilts / self.reach

    def apply(self, x: Float) -> Sensor:
        """The sensor at parameters x (size,)."""
        stack, k = self._stacked(x), len(self.sensor.curve.points)
        pivot, axes, _ = self._frame(x)
        plane = Plane(pivot - axes[:, :2] @ self.center, axes)
        return replace(self.sensor, plane=plane, curve=Hermite(stack[:k], stack[k:]))

    def points(self, x: Float) -> Float:
        """Sampled path (p, 3) in the rest frame."""
        pivot, axes, _ = self._frame(x)
        local = self._basis @ self._stacked(x) - self.center
        return np.asarray(pivot + local @ axes[:, :2].T)

    def pull(self, x: Float, by_points: Float) -> Float:
        """Derivative (size,) of a value by the parameters, from that by the points (p, 3)."""
        _, axes, tilts = self._frame(x)
        out = np.empty(self.size)
        inside = self._basis_of_rows.T @ (by_points @ axes[:, :2])
        out[: inside.size] = inside.ravel()
        if self._plane:
            local = self._basis @ self._stacked(x) - self.center
            moment = by_points.T @ local
            out[-3] = by_points.sum(0) @ self.sensor.plane.normal
            out[-2:] = np.einsum("tij,ij->t", tilts[:, :, :2], moment)
        return out

    def path(self, x: Float) -> tuple[Float, Float]:
        """`points` (p, 3) and their derivative (p, 3, size)."""
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


@numba.njit(cache=True)
def _tilted(axes, a, b):  # type: ignore[no-untyped-def]
    """Axes turned about their x by a, then y by b (rad), and the derivatives by both."""
    ca, sa, cb, sb = np.cos(a), np.sin(a), np.cos(b), np.sin(b)
    rx = np.array([[1.0, 0, 0], [0, ca, -sa], [0, sa, ca]])
    ry = np.array([[cb, 0, sb], [0.0, 1, 0], [-sb, 0, cb]])
    by = np.empty((2, 3, 3))
    by[0] = axes @ np.array([[0.0, 0, 0], [0, -sa, -ca], [0, ca, -sa]]) @ ry
    by[1] = axes @ rx @ np.array([[-sb, 0, cb], [0.0, 0, 0], [-cb, 0, -sb]])
    return axes @ rx @ ry, by
