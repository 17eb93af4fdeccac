"""Measure how far each pose has been shown, by comparing markers with the simulated shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from ..tracking.alignment import align

BINS = 5  # parts of the way from rest to a pose's full extent
MAX_DISTANCE = 0.5  # from a shape, relative to the shape's distance from rest
MIN_MARKERS = 4


class PoseCoverage:
    """Shows which parts of the way to each pose were seen.

    Args:
        names: Names of the poses (p,).
        shapes: Markers at the levels 1/BINS, ..., 1 of each pose (p, BINS, m, 3), mm.
        rest: Markers at rest (m, 3), mm.
    """

    def __init__(self, names: Sequence[str], shapes: Float, rest: Float) -> None:
        self._names = list(names)
        self._all_shapes = np.concatenate([rest[None], shapes.reshape(-1, *rest.shape)])
        self._rest = rest
        self._covered = np.zeros((len(self._names), BINS), bool)

    def add(self, points: Float) -> tuple[str, int] | None:
        """Add a frame: the shape that is nearest, up to a rigid motion, was seen.

        Args:
            points: Markers (m, 3), mm, in any frame of reference, NaN where not visible.

        Returns:
            Pose and part of the way (0 to BINS - 1), if it was not seen before; else None.
        """
        is_visible = np.isfinite(points[:, 0])
        if is_visible.sum() < MIN_MARKERS:
            return None
        shapes = np.where(is_visible[:, None], self._all_shapes, np.nan)
        try:
            aligned = align(shapes, np.where(is_visible[:, None], points, np.nan))
            from_rest = align(shapes, np.where(is_visible[:, None], self._rest, np.nan))
        except CaptureError:  # the visible markers are on one line
            return None
        distance = np.where(aligned.ok, aligned.residual, np.inf)
        best = int(distance.argmin())
        # Less than half a step from rest is rest; far from all shapes is another shape.
        if best == 0 or distance[best] > MAX_DISTANCE * from_rest.residual[best]:
            return None
        pose, part = divmod(best - 1, BINS)
        if self._covered[pose, part]:
            return None
        self._covered[pose, part] = True
        return self._names[pose], part

    def restore(self, pose: str, part: int) -> None:
        """Mark a part as covered before; poses that the device no longer has are ignored."""
        if pose in self._names and 0 <= part < BINS:
            self._covered[self._names.index(pose), part] = True

    def reached(self) -> dict[str, tuple[float, Bool]]:
        """Return by pose how far it was shown, 0 to 1, and which of its parts are covered."""
        extents = [
            (np.flatnonzero(covered).max(initial=-1) + 1) / BINS for covered in self._covered
        ]
        return {
            name: (float(extent), covered.copy())
            for name, extent, covered in zip(self._names, extents, self._covered, strict=True)
        }

    def least_covered(self) -> str:
        """Return the pose of which least was shown; empty if all were shown completely."""
        covered = self._covered.mean(axis=1)
        k = int(covered.argmin())
        return self._names[k] if covered[k] < 1 else ""
