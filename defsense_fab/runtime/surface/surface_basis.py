"""What is known of a surface before it moves: its shape at rest, and simulated states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Bool, Float, Int


@dataclass(frozen=True)
class SurfaceBasis:
    """`vertices` (v, 3) mm at rest and `triangles` (f, 3), each vertex in one at least;
    displacements of simulated `states` (s, v, 3) mm, which may be none; `fixed` (v,) vertices that
    no state moves."""

    vertices: Float
    triangles: Int
    states: Float
    fixed: Bool

    def __post_init__(self) -> None:
        count = len(self.vertices)
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or count < 4:
            raise ValueError("surface basis: vertices must have shape (v, 3) with v > 3")
        if self.triangles.ndim != 2 or self.triangles.shape[1] != 3:
            raise ValueError("surface basis: triangles must have shape (f, 3)")
        if self.states.shape[1:] != (count, 3) or self.fixed.shape != (count,):
            raise ValueError("surface basis: states must be (s, v, 3), fixed (v,)")
        if not (np.isfinite(self.vertices).all() and np.isfinite(self.states).all()):
            raise ValueError("surface basis: vertices and states must be finite")
        if not np.array_equal(np.unique(self.triangles), np.arange(count)):
            raise ValueError("surface basis: triangles must name every vertex, and no others")
        if self.fixed.all():
            raise ValueError("surface basis: some vertex must be free")

    @classmethod
    def at_rest(cls, vertices: Float, triangles: Int) -> SurfaceBasis:
        """Without states: nothing is known of how it deforms."""
        count = len(vertices)
        return cls(
            np.asarray(vertices, float), np.asarray(triangles, np.int64), np.zeros((0, count, 3)),
            np.zeros(count, bool),
        )  # fmt: skip

    @property
    def size(self) -> float:
        """Diagonal of the bounding box, mm."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))
