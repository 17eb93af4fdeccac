"""A cord at given parameters: its samples, and how they and its limits follow the parameters."""

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
    """Stacked control points and tangents (2 k, 2), samples `points` (p, 3) mm in the rest frame,
    and the same `local` (p, 2) in the plane, off its pivot (3,); the plane's axes (3, 3) and their
    derivatives `turns` (t, 3, 3) by its turns, t = 3 or 0."""

    cord: CordParameters
    stack: Float
    points: Float
    local: Float
    pivot: Float
    axes: Float
    turns: Float

    def sensor(self) -> Sensor:
        cord, k = self.cord, len(self.stack) // 2
        plane = Plane(self.pivot - self.axes[:, :2] @ cord.center, self.axes)
        return replace(cord.sensor, plane=plane, curve=Hermite(self.stack[:k], self.stack[k:]))

    def pull(self, by_points: Float) -> Float:
        """Derivatives (size, s) of s values by the parameters, from those by the points
        (p, 3, s)."""
        out = np.zeros((self.cord.size, by_points.shape[2]))
        _pull(
            self.cord.basis_of_rows, self.local, self.axes, self.turns, self.cord.moves, by_points,
            out,
        )  # fmt: skip
        return out

    def pull_one(self, by_points: Float) -> Float:
        """The same (size,) for one value, from (p, 3)."""
        out, count = np.zeros((1, self.cord.size)), len(by_points)
        self.add_moves(np.zeros(count, np.int64), np.arange(count), by_points, out)
        return np.asarray(out[0])

    def add_moves(self, rows: Int, samples: Int, directions: Float, out: Float) -> None:
        """Add to the rows (q,) of out (..., size) the derivatives of how far the samples (q,) move
        along the directions (q, 3)."""
        if self.cord.size:
            _add_moves(
                self.cord.basis_of_rows, self.local, self.axes, self.turns, self.cord.moves,
                rows, samples, directions, out,
            )  # fmt: skip

    def height(self, point: Float) -> tuple[float, Float]:
        """How far the point (3,) lies above the plane, mm, and the derivative (size,)."""
        by = np.zeros(self.cord.size)
        if self.cord.has_plane:
            by[-FRAME_SIZE:-3] = -self.cord.moves @ self.axes[:, 2]
            by[-3:] = self.turns[:, :, 2] @ (point - self.pivot)
        return float((point - self.pivot) @ self.axes[:, 2]), by

    def turning(self, radius: float) -> tuple[Float, Float]:
        """How far from turning tighter than `radius` mm, (q,) at span ends and inside, then how far
        from standing still there, and the derivatives (2 q, size).

        1 - radius |curvature|, and the speed over the least that a path may have, less one: where
        the speed vanishes a path has a cusp, and its curvature means nothing.
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
        grown = np.where(speed > least, 3 * turn * cross / scale**2, 0.0)  # by the square of speed
        for axis, by_cross in enumerate(
            (f * dd[:, 1:] - d[:, 1:] * s, d[:, :1] * s - f * dd[:, :1])
        ):
            by_square = d[:, axis, None] * f
            inside[:k, axis::2] = grown[:, None] * by_square - turn[:, None] * by_cross
            inside[k:, axis::2] = by_square / np.maximum(speed * least, 1e-9)[:, None]
        return value, derivative


def place_cord(cord: CordParameters, x: Float) -> PlacedCord:
    """The cord at parameters x (size,)."""
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
    """Turn axes (3, 3) about their own axis k by the angle of cosine c and sine s, in place; with
    the derivatives of both and rest = 0, the derivative."""
    i, j = (k + 1) % 3, (k + 2) % 3
    for d in range(3):
        a, b = axes[d, i], axes[d, j]
        axes[d, i], axes[d, j], axes[d, k] = c * a + s * b, c * b - s * a, rest * axes[d, k]


@compiled()
def _pull(basis, local, axes, turns, moves, by_points, out):  # type: ignore[no-untyped-def]
    """Add the derivatives by the points (p, 3, s), carried on to the parameters, to out."""
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
