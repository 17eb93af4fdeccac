"""The free parameters of a cord and how its path follows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numba
import numpy as np

from ..core.arrays import Float, Int
from ..core.curve import Hermite, Plane, distinct, hermite_basis
from ..core.device import Sensor

#: A path is sampled with at least this many points for signals and in `layout.json`.
SAMPLES = 120
_FRAME = 5  # parameters of a free plane: two moves, three turns


def per_span(sensor: Sensor) -> int:
    return int(np.ceil(SAMPLES / (len(sensor.curve.points) - 1)))


def sample_path(sensor: Sensor) -> Float:
    """The path's points (p, 3) in the rest frame, p > 100."""
    return sensor.plane.to_world(sensor.curve.sample(per_span(sensor)))


class CordFreedom:
    """Parameters of one sensor, all in mm: interior control points, tangents, and the plane.

    The first and last two control points and the end tangents stay where they are in the plane's
    frame. The frame moves along its normal and, in the plane, across the path's chord, and turns
    about the path's middle; a turn counts as the movement it causes at half the path's extent.
    """

    def __init__(self, sensor: Sensor, lead: CordFreedom | None = None) -> None:
        """With `lead`, a cord in the same frame, the frame's parameters mean what they mean there:
        equal ones keep both cords in one plane."""
        self.sensor = sensor
        k = len(sensor.curve.points)
        self._stack = np.concatenate([sensor.curve.points, sensor.curve.tangents])
        rows = [*range(2, k - 2), *range(k + 1, 2 * k - 1)] if "path" in sensor.free else []
        self._rows = np.array(rows, int)
        self._plane = "plane" in sensor.free
        chord = sensor.curve.points[-1] - sensor.curve.points[0]
        side = np.array([-chord[1], chord[0]]) if np.linalg.norm(chord) > 1e-6 else np.eye(2)[1]
        side = sensor.plane.axes[:, :2] @ side / np.linalg.norm(side)
        self._moves = np.stack([sensor.plane.normal, side])
        self.size = 2 * len(rows) + _FRAME * self._plane
        self.center = (sensor.curve.points.min(0) + sensor.curve.points.max(0)) / 2
        self._pivot = sensor.plane.to_world(self.center)
        self.reach = float(np.linalg.norm(np.ptp(sensor.curve.points, axis=0))) / 2
        if lead is not None:
            self.center, self._pivot, self.reach = lead.center, lead._pivot, lead.reach
            self._moves = lead._moves
        self._per_span = per_span(sensor)
        self._basis = hermite_basis(k, self._per_span)[0]
        self._basis_of_rows = np.ascontiguousarray(self._basis[:, self._rows])
        _, self._first, self._second = hermite_basis(k, 8)
        speed = np.linalg.norm(self._first @ self._stack, axis=1)
        self._drawn_speed = np.maximum(speed, 1e-3 * speed.max())

    def _stacked(self, x: Float) -> Float:
        stack = self._stack.copy()
        if len(self._rows):
            stack[self._rows] += x[: 2 * len(self._rows)].reshape(-1, 2)
        return stack

    def _frame(self, x: Float) -> tuple[Float, Float, Float]:
        """Pivot (3,), axes (3, 3), and the axes' derivatives (t, 3, 3) by the turns, t = 3 or 0."""
        if not self._plane:
            return self._pivot, self.sensor.plane.axes, np.zeros((0, 3, 3))
        axes, turns = _turned(self.sensor.plane.axes, x[-3:] / self.reach)
        return self._pivot + x[-_FRAME:-3] @ self._moves, axes, turns / self.reach

    def apply(self, x: Float) -> Sensor:
        """The sensor at parameters x (size,)."""
        stack, k = self._stacked(x), len(self.sensor.curve.points)
        pivot, axes, _ = self._frame(x)
        plane = Plane(pivot - axes[:, :2] @ self.center, axes)
        return replace(self.sensor, plane=plane, curve=Hermite(stack[:k], stack[k:]))

    def points(self, x: Float) -> Float:
        """Sampled path (p, 3) in the rest frame."""
        pivot, axes, _ = self._frame(x)
        return _spread_out(self._basis, self._stacked(x), self.center, pivot, axes)  # type: ignore[no-any-return]

    def pull(self, x: Float, by_points: Float) -> Float:
        """Derivatives (size, s) of s values by the parameters, from those by the points
        (p, 3, s)."""
        _, axes, turns = self._frame(x)
        out = np.zeros((self.size, by_points.shape[2]))
        _gather(self._basis_of_rows, axes, by_points, out)
        if self._plane:
            local = self._basis @ self._stacked(x) - self.center
            out[-_FRAME:-3] = self._moves @ by_points.sum(0)
            moment = local.T @ by_points.reshape(len(local), -1)  # (2, 3 s)
            out[-3:] = turns[:, :, :2].transpose(0, 2, 1).reshape(3, -1) @ moment.reshape(6, -1)
        return out

    def height(self, x: Float, point: Float) -> tuple[float, Float]:
        """How far the point (3,) lies above the plane, mm, and the derivative (size,)."""
        pivot, axes, turns = self._frame(x)
        by = np.zeros(self.size)
        if self._plane:
            by[-_FRAME:-3] = -self._moves @ axes[:, 2]
            by[-3:] = turns[:, :, 2] @ (point - pivot)
        return float((point - pivot) @ axes[:, 2]), by

    def motion(self, x: Float) -> tuple[Float, tuple[Float, Float, Float, Float, Float]]:
        """`points` (p, 3), and what moves them, for `track.py`: the basis (p, r) of the free rows,
        the axes (3, 3), the directions (2, 3) of the frame's moves, the axes' derivatives
        (3, 3, 3) by its turns, or none, and the samples (p, 2) in the plane, off its pivot."""
        pivot, axes, turns = self._frame(x)
        local = self._basis @ self._stacked(x) - self.center
        points = pivot + local @ axes[:, :2].T
        return points, (self._basis_of_rows, axes, self._moves, turns, local)

    def turning(self, x: Float, radius: float) -> tuple[Float, Float]:
        """How far from turning tighter than `radius` mm, (q,) at span ends and inside, and the
        derivative (q, size).

        speed^3 - radius |x' y'' - y' x''|, over the drawing's speed^3: it has the sign of
        1 - radius |curvature|, and stays smooth and small where the speed vanishes.
        """
        stack = self._stacked(x)
        d, dd = self._first @ stack, self._second @ stack
        speed = np.linalg.norm(d, axis=1)
        cross = d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]
        turn = radius * np.where(cross < 0, -1.0, 1.0)
        value = (speed**3 - turn * cross) / self._drawn_speed**3
        f, s = self._first[:, self._rows], self._second[:, self._rows]
        derivative = np.zeros((len(value), self.size))
        inside = derivative[:, : 2 * len(self._rows)]
        for axis, by_cross in enumerate(
            (f * dd[:, 1:] - d[:, 1:] * s, d[:, :1] * s - f * dd[:, :1])
        ):
            by_speed = 3 * (speed * d[:, axis])[:, None] * f
            inside[:, axis::2] = by_speed - turn[:, None] * by_cross
        return value, derivative / self._drawn_speed[:, None] ** 3


def together(sensors: Sequence[Sensor]) -> tuple[list[CordFreedom], Int]:
    """Freedoms of a layout whose coplanar cords stay coplanar where their plane is free, and for
    each of their parameters (size,) which of the layout's own it is."""
    cords: list[CordFreedom] = []
    which: list[Int] = []
    count = 0
    for sensor in sensors:
        if "plane" in sensor.free and any(
            "plane" not in s.free and len(distinct([s.plane, sensor.plane])) == 1 for s in sensors
        ):  # a plane that another cord holds
            sensor = replace(sensor, free=sensor.free - {"plane"})
        lead = next((i for i, c in enumerate(cords) if _joined(c.sensor, sensor)), None)
        if lead is None:
            cord = CordFreedom(sensor)
            own = count + np.arange(cord.size)
            count += cord.size
        else:
            leader = cords[lead]
            cord = CordFreedom(_in_frame(sensor, leader.sensor.plane), leader)
            own = np.concatenate([count + np.arange(cord.size - _FRAME), which[lead][-_FRAME:]])
            count += cord.size - _FRAME
        cords.append(cord)
        which.append(own)
    return cords, np.concatenate(which)


def _joined(a: Sensor, b: Sensor) -> bool:
    return "plane" in a.free and "plane" in b.free and len(distinct([a.plane, b.plane])) == 1


def _in_frame(sensor: Sensor, plane: Plane) -> Sensor:
    """The same cord in another frame of its plane."""
    turn = plane.axes[:, :2].T @ sensor.plane.axes[:, :2]
    shift = (sensor.plane.origin - plane.origin) @ plane.axes[:, :2]
    curve = sensor.curve
    return replace(
        sensor,
        plane=plane,
        curve=Hermite(curve.points @ turn.T + shift, curve.tangents @ turn.T),
    )


@numba.njit(cache=True, nogil=True)
def _spread_out(basis, stack, center, pivot, axes):  # type: ignore[no-untyped-def]
    """Points (p, 3): basis (p, r) times stack (r, 2), off the centre, in the plane's frame."""
    out = np.empty((len(basis), 3))
    for p in range(len(basis)):
        x, y = -center[0], -center[1]
        for r in range(len(stack)):
            x += basis[p, r] * stack[r, 0]
            y += basis[p, r] * stack[r, 1]
        for a in range(3):
            out[p, a] = pivot[a] + x * axes[a, 0] + y * axes[a, 1]
    return out


@numba.njit(cache=True, nogil=True)
def _gather(basis, axes, by_points, out):  # type: ignore[no-untyped-def]
    """Derivatives by the points (p, 3, s) to those by in-plane coordinates, two rows of out
    (2 r + ..., s) for each column of basis (p, r)."""
    states = by_points.shape[2]
    u, v = np.empty(states), np.empty(states)
    for p in range(len(basis)):
        for s in range(states):
            x, y, z = by_points[p, 0, s], by_points[p, 1, s], by_points[p, 2, s]
            u[s] = x * axes[0, 0] + y * axes[1, 0] + z * axes[2, 0]
            v[s] = x * axes[0, 1] + y * axes[1, 1] + z * axes[2, 1]
        for r in range(basis.shape[1]):
            w = basis[p, r]
            if w != 0.0:  # a point follows the four rows of its span
                for s in range(states):
                    out[2 * r, s] += w * u[s]
                    out[2 * r + 1, s] += w * v[s]


@numba.njit(cache=True, nogil=True)
def _turned(axes, angles):  # type: ignore[no-untyped-def]
    """Axes turned about their own x, y and z in that order by angles (3,) rad, and the derivatives
    (3, 3, 3) by each."""
    turns, slopes = np.empty((3, 3, 3)), np.empty((3, 3, 3))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        c, s = np.cos(angles[k]), np.sin(angles[k])
        turns[k], slopes[k] = np.eye(3), np.zeros((3, 3))
        turns[k, i, i], turns[k, i, j], turns[k, j, i], turns[k, j, j] = c, -s, s, c
        slopes[k, i, i], slopes[k, i, j], slopes[k, j, i], slopes[k, j, j] = -s, -c, c, -s
    by = np.empty((3, 3, 3))
    by[0] = axes @ slopes[0] @ turns[1] @ turns[2]
    by[1] = axes @ turns[0] @ slopes[1] @ turns[2]
    by[2] = axes @ turns[0] @ turns[1] @ slopes[2]
    return axes @ turns[0] @ turns[1] @ turns[2], by
