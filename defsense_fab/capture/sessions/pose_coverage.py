"""How far each pose has been shown: markers compared with the simulated shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from ..tracking.alignment import align

#: Parts of a pose's way, from rest to its full extent.
BINS = 5
_NEAR = 0.5  # of the way between rest and a shape: farther from it, it is not that shape
_FEWEST = 4  # markers that tell shapes apart


class PoseCoverage:
    """Of poses by name: where m markers are, `shapes` (p, BINS, m, 3) mm, at the levels 1/BINS, ...
    1 of each, and at `rest` (m, 3) mm."""

    def __init__(self, names: Sequence[str], shapes: Float, rest: Float) -> None:
        self._names = list(names)
        self._all = np.concatenate([rest[None], shapes.reshape(-1, *rest.shape)])
        self._rest = rest
        self._seen = np.zeros((len(self._names), BINS), bool)

    def add(self, points: Float) -> tuple[str, int] | None:
        """Markers (m, 3) mm of a frame, in any frame of reference, NaN where not seen: the shape
        that is nearest, by rigid motions, was seen. Its pose and part of the way (0 to BINS - 1) if
        it was not seen before."""
        there = np.isfinite(points[:, 0])
        if there.sum() < _FEWEST:
            return None
        shapes = np.where(there[:, None], self._all, np.nan)
        try:
            found = align(shapes, np.where(there[:, None], points, np.nan))
            from_rest = align(shapes, np.where(there[:, None], self._rest, np.nan))
        except CaptureError:  # the markers that are seen lie on one line
            return None
        gap = np.where(found.ok, found.residual, np.inf)
        best = int(gap.argmin())
        # Less than half of a step away from rest it is rest; far from all shapes it is another one.
        if best == 0 or gap[best] > _NEAR * from_rest.residual[best]:
            return None
        pose, part = divmod(best - 1, BINS)
        if self._seen[pose, part]:
            return None
        self._seen[pose, part] = True
        return self._names[pose], part

    def restore(self, pose: str, part: int) -> None:
        """A part of a pose's way was seen before; poses that the device has no more are left."""
        if pose in self._names and 0 <= part < BINS:
            self._seen[self._names.index(pose), part] = True

    def reached(self) -> dict[str, tuple[float, Bool]]:
        """Of each pose how far it was shown, 0 to 1, and which parts of the way were seen."""
        most = [(np.flatnonzero(s).max(initial=-1) + 1) / BINS for s in self._seen]
        return {
            n: (float(m), s.copy()) for n, m, s in zip(self._names, most, self._seen, strict=True)
        }

    def todo(self) -> str:
        """The pose that was shown least; empty where all were shown."""
        covered = self._seen.mean(axis=1)
        k = int(covered.argmin())
        return self._names[k] if covered[k] < 1 else ""
