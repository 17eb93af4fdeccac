"""Place a cord at given parameters, and differentiate its samples and limits by them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import Hermite, Plane
from ...core.device.device import Sensor
from ...core.machine.compiled import compiled
from ...core.machine.copying import copy_rows
from .cord_parameters import FRAME_SIZE, CordParameters


@dataclass(frozen=True, slots=True)
class PlacedCord:
    """A cord at given parameters.

    Attributes:
        cord: The parameters' definition.
        stack: (2 k, 2) mm, control points above tangents.
        points: (p, 3) mm, samples of the path in the rest frame.
        local: (p, 2) mm, the same samples in the plane, relative to the pivot.
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
        plane = Plane(self.pivot - self.axes[:, :2] @ cord.center, self.axes)
        return replace(cord.sensor, plane=plane, curve=Hermite(self.stack[:k], self.stack[k:]))

    def pull(self, by_points: Float) -> Float:
        """Return derivatives (size, s) by the parameters from those by the points (p, 3, s)."""
        out = np.zeros((self.cord.size, by_points.shape[2]))
        _pull(
            self.cord.basis_of_rows, self.local, self.axes, self.turns, self.cord.moves, by_points,
            out,
        )  # fmt: skip
        return out

    def pull_one(self, by_points: Float) -> Float:
        """Return the derivatives (size,) of one value from those by the points (p, 3)."""
        out, count = np.zeros((1, self.cord.size)), len(by_points)
        self.add_moves(np.zeros(count, np.int64), np.arange(count), by_points, out)
        return np.asarray(out[0])

    def add_moves(self, rows: Int, samples: Int, directions: Float, out: Float) -> None:
        """Add the derivatives of the motion of samples along directions.

        Args:
            rows: (q,) rows of `out` to add to.
            samples: (q,) numbers of the samples.
            directions: (q, 3) directions.
            out: (..., size), changed in place.
        """
        if self.cord.size:
            _add_moves(
                self.cord.basis_of_rows, self.local, self.axes, self.turns, self.cord.moves,
                rows, samples, directions, out,
            )  # fmt: skip

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
        cross = d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]
        turn = radius * np.where(cross < 0, -1.0, 1.0) / scale**3
        value = np.concatenate([1 - turn * cross, speed / least - 1])
        f, s = cord.first[:, cord.rows], cord.second[:, cord.rows]
        derivative = np.zeros((2 * k, cord.size))
        inside = derivative[:, : 2 * len(cord.rows)]
        # Derivative by the square of the speed.
        grown = np.where(speed > least, 3 * turn * cross / scale**2, 0.0)
        for axis, by_cross in enumerate(
            (f * dd[:, 1:] - d[:, 1:] * s, d[:, :1] * s - f * dd[:, :1])
        ):
            by_square = d[:, axis, None] * f
            inside[:k, axis::2] = grown[:, None] * by_square - turn[:, None] * by_cross
            inside[k:, axis::2] = by_square / np.maximum(speed * least, 1e-9)[:, None]
        return value, derivative


def place_cord(cord: CordParameters, x: Float) -> PlacedCord:
    """Place a cord at parameters x (size,) mm."""
    stack, pivot, axes = cord.stack.copy(), cord.pivot.copy(), cord.sensor.plane.axes.copy()
    points, local = np.empty((len(cord.basis), 3)), np.empty((len(cord.basis), 2))
    turns = np.empty((3 if cord.has_plane else 0, 3, 3))
    _place(
        x, cord.rows, cord.basis, cord.center, cord.moves, cord.reach, stack, pivot, axes, turns,
        local, points,
    )  # fmt: skip
    return PlacedCord(cord, stack, points, local, pivot, axes, turns)


@compiled()
def _place(  # type: ignore[no-untyped-def]
    x, rows, basis, center, moves, reach, stack, pivot, axes, turns, local, points
):
    for r in range(len(rows)):
        for a in range(2):
            stack[rows[r], a] += x[2 * r + a]
    if len(turns):
        frame = 2 * len(rows)
        for k in range(3):
            copy_rows(axes, turns[k])
        for k in range(3):
            angle = x[frame + 2 + k] / reach
            c, s = np.cos(angle), np.sin(angle)
            for t in range(3):
                if t == k:
                    _turn(turns[t], k, -s / reach, c / reach, 0.0)
                else:
                    _turn(turns[t], k, c, s, 1.0)
            _turn(axes, k, c, s, 1.0)
            for d in range(3):
                pivot[d] += 0.0 if k == 2 else x[frame + k] * moves[k, d]
    for p in range(len(basis)):
        u, v = -center[0], -center[1]
        for r in range(len(stack)):
            if basis[p, r] != 0.0:  # a point follows the four rows of its span
                u += basis[p, r] * stack[r, 0]
                v += basis[p, r] * stack[r, 1]
        local[p, 0], local[p, 1] = u, v
        for d in range(3):
            points[p, d] = pivot[d] + u * axes[d, 0] + v * axes[d, 1]


@compiled()
def _turn(axes, k, c, s, rest):  # type: ignore[no-untyped-def]
    """Turn axes (3, 3) about their axis k, in place, by the angle of cosine c and sine s.

    With the derivatives of both and rest = 0 the result is the derivative of the axes.
    """
    i, j = (k + 1) % 3, (k + 2) % 3
    for d in range(3):
        a, b = axes[d, i], axes[d, j]
        axes[d, i], axes[d, j], axes[d, k] = c * a + s * b, c * b - s * a, rest * axes[d, k]


@compiled()
def _pull(basis, local, axes, turns, moves, by_points, out):  # type: ignore[no-untyped-def]
    """Add the derivatives by the points (p, 3, s), propagated to the parameters, to `out`."""
    states, rows = by_points.shape[2], basis.shape[1]
    u, v = np.empty(states), np.empty(states)
    total, moment = np.zeros((3, states)), np.zeros((3, 2, states))
    for p in range(len(basis)):
        for s in range(states):
            x, y, z = by_points[p, 0, s], by_points[p, 1, s], by_points[p, 2, s]
            u[s] = x * axes[0, 0] + y * axes[1, 0] + z * axes[2, 0]
            v[s] = x * axes[0, 1] + y * axes[1, 1] + z * axes[2, 1]
        for r in range(rows):
            w = basis[p, r]
            if w != 0.0:
                for s in range(states):
                    out[2 * r, s] += w * u[s]
                for s in range(states):
                    out[2 * r + 1, s] += w * v[s]
        if len(turns):
            for d in range(3):
                for s in range(states):
                    total[d, s] += by_points[p, d, s]
                for a in range(2):
                    for s in range(states):
                        moment[d, a, s] += local[p, a] * by_points[p, d, s]
    if len(turns):
        for d in range(3):
            for s in range(states):
                for m in range(2):
                    out[2 * rows + m, s] += moves[m, d] * total[d, s]
                for t in range(3):
                    for a in range(2):
                        out[2 * rows + 2 + t, s] += turns[t, d, a] * moment[d, a, s]


@compiled()
def _add_moves(  # type: ignore[no-untyped-def]
    basis, local, axes, turns, moves, rows, samples, directions, out
):
    own = 2 * basis.shape[1]
    for n in range(len(rows)):
        q, i = rows[n], samples[n]
        x, y, z = directions[n, 0], directions[n, 1], directions[n, 2]
        u = x * axes[0, 0] + y * axes[1, 0] + z * axes[2, 0]
        v = x * axes[0, 1] + y * axes[1, 1] + z * axes[2, 1]
        for r in range(basis.shape[1]):
            w = basis[i, r]
            if w != 0.0:
                out[q, 2 * r] += w * u
                out[q, 2 * r + 1] += w * v
        if len(turns):
            for d in range(3):
                for m in range(2):
                    out[q, own + m] += directions[n, d] * moves[m, d]
                for t in range(3):
                    moved = turns[t, d, 0] * local[i, 0] + turns[t, d, 1] * local[i, 1]
                    out[q, own + 2 + t] += directions[n, d] * moved
