"""Candidate cords as arrays, many of one kind at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import catmull_rom, Hermite, hermite_basis, Plane
from ...core.device.device import Sensor

COARSE = 40  #: Points of a candidate's path.


@dataclass(frozen=True)
class Batch:
    """Candidates as arrays: plane `origins` (c, 3) and `axes` (c, 3, 3), control `points` and
    `tangents` (c, k, 2); name and freedom are those of `like`."""

    like: Sensor
    origins: Float
    axes: Float
    points: Float
    tangents: Float

    def __len__(self) -> int:
        return len(self.points)

    def paths(self, count: int) -> Float:
        """`count` points of each path, evenly spread over the parameter, (c, count, 3) mm."""
        few = hermite_basis(self.points.shape[1], 24)[0][self.at(count)]
        local = few @ np.concatenate([self.points, self.tangents], axis=1)
        return np.asarray(self.origins[:, None] + local @ self.axes[:, :, :2].swapaxes(1, 2))

    def at(self, count: int) -> Int:
        """Which of a path's samples, 24 a span, `paths` takes."""
        last = 24 * (self.points.shape[1] - 1)
        return np.asarray(np.round(np.linspace(0, last, count)).astype(int))

    def out(self) -> Float:
        """Unit directions (c, 2, 3) in which the straight runs leave the paths' ends."""
        ends = self.tangents[:, [0, -1]] @ self.axes[:, :, :2].swapaxes(1, 2)
        size = np.maximum(np.linalg.norm(ends, axis=2, keepdims=True), 1e-12)
        return np.asarray(ends / size * np.array([[-1.0], [1.0]]))

    def waved(self, waves: Float, size: Float) -> Batch:
        """With waves (c, k) of `size` (c,) mm across their chords; paths of size 0 stay as they
        are, and so do the first and last two control points and the end tangents."""
        chord = self.points[:, -1] - self.points[:, 0]
        length = np.linalg.norm(chord, axis=1, keepdims=True)
        side = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / np.maximum(length, 1e-6)
        side = np.where(length > 1e-6, side, [0.0, 1.0])
        points, tangents = self.points.copy(), self.tangents.copy()
        points[:, 2:-2] += (waves * size[:, None])[:, 2:-2, None] * side[:, None]
        moved = size > 0
        tangents[moved, 1:-1] = catmull_rom(points[moved])[:, 1:-1]
        return replace(self, points=points, tangents=tangents)

    def take(self, which: Int) -> Batch:
        arrays = (self.origins, self.axes, self.points, self.tangents)
        return Batch(self.like, *(a[which] for a in arrays))

    def sensor(self, i: int) -> Sensor:
        return replace(
            self.like,
            plane=Plane(self.origins[i], self.axes[i]),
            curve=Hermite(self.points[i], self.tangents[i]),
        )
