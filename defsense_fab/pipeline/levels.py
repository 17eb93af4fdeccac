"""How far each pose has been shown: markers compared with the simulated movement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.arrays import Bool, Float

#: Parts of a pose's way, from rest to its full extent.
BINS = 5
_ALIKE = 0.7  # least cosine between what is seen and a pose, for it to count as that pose
_LEAST = 0.08  # of the pose's extent: below that it is rest


class Levels:
    """Of each pose by name: displacements `extents` (p, m, 3) mm of m markers at its full extent,
    their `rest` places (m, 3) mm."""

    def __init__(self, names: Sequence[str], extents: Float, rest: Float) -> None:
        self._names, self._extents, self._rest = list(names), extents, rest
        self._most = np.zeros(len(self._names))
        self._seen = np.zeros((len(self._names), BINS), bool)

    def add(self, points: Float) -> None:
        """Aligned markers (m, 3) mm of a frame, NaN where not seen."""
        there = np.isfinite(points[:, 0])
        if there.sum() < 3:
            return
        moved = (points - self._rest)[there]
        moved = moved - moved.mean(axis=0)
        for k, extent in enumerate(self._extents):
            full = _without_rigid(extent[there], self._rest[there])
            size = float((full**2).sum())
            if size <= 0:
                continue
            shown = _without_rigid(moved, self._rest[there])
            level = float((shown * full).sum() / size)
            length = float(np.sqrt((shown**2).sum() * size))
            if level < _LEAST or (shown * full).sum() < _ALIKE * length:
                continue
            self._most[k] = max(self._most[k], level)
            self._seen[k, min(int(level * BINS), BINS - 1)] = True

    def reached(self) -> dict[str, tuple[float, Bool]]:
        """Of each pose how far, 0 to 1 and beyond, and which parts of the way."""
        return {
            n: (float(m), s.copy())
            for n, m, s in zip(self._names, self._most, self._seen, strict=True)
        }

    def todo(self) -> str:
        """The pose that was shown least; empty where all were shown."""
        covered = self._seen.mean(axis=1)
        k = int(covered.argmin())
        return self._names[k] if covered[k] < 1 else ""


def _without_rigid(moved: Float, rest: Float) -> Float:
    """Displacements (m, 3) mm without what a small rigid motion explains."""
    x = rest - rest.mean(axis=0)
    u = moved - moved.mean(axis=0)
    A = np.zeros((len(x), 3, 3))
    A[:, 0, 1], A[:, 0, 2] = x[:, 2], -x[:, 1]
    A[:, 1, 0], A[:, 1, 2] = -x[:, 2], x[:, 0]
    A[:, 2, 0], A[:, 2, 1] = x[:, 1], -x[:, 0]
    flat = A.reshape(-1, 3)
    turn, *_ = np.linalg.lstsq(flat, u.ravel(), rcond=None)
    return np.asarray(u - (flat @ turn).reshape(-1, 3))
