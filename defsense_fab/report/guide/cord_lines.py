"""Where a cord lies in the device: its line, its ends, its ferrules. Drawings and templates show
it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths, resample
from ...store.layout import LayoutRecord
from ...store.manifest import CordStretch, CutCord


@dataclass(frozen=True)
class CordLine:
    """A `cord` along the `points` (p, 3) mm of its channel from mouth to mouth."""

    cord: CutCord
    points: Float

    def way_out(self, end: int) -> Float:
        """The direction (3,) in which it leaves the body at an end."""
        p = self.points
        away = p[0] - p[3] if end == 0 else p[-1] - p[-4]
        return np.asarray(away / np.linalg.norm(away))

    def ferrule(self, end: int, length: float) -> Float:
        """The middle (3,) mm of its ferrule of `length` mm: at the bottom of the pocket, or behind
        the free end."""
        record = self.cord.ends[end]
        depth = record.pocket - length / 2 if record.joint == "pocket" else -record.lead
        return np.asarray(record.at - depth * self.way_out(end))

    def along(self, start: float, stop: float, per_mm: float = 1.0) -> Float:
        """Points (q, 3) mm from `start` to `stop`, mm from its first mouth, or to its last one."""
        stop = min(stop, float(arc_lengths(self.points)[-1]))
        return resample(self.points, start, stop, max(2, int(per_mm * (stop - start)) + 1))

    def ends_in(self, stretch: CordStretch) -> list[int]:
        """Which of its ends a stretch has."""
        last = len(self.cord.stretches) - 1
        return [e for e, k in ((0, 0), (1, last)) if self.cord.stretches[k] is stretch]


def cord_line(layout: LayoutRecord, cord: CutCord) -> CordLine:
    """Of a cord in its layout."""
    points = next(s.points for s in layout.sensors if s.name == cord.sensor)
    line = np.concatenate([cord.ends[0].at[None], points, cord.ends[1].at[None]])
    apart = np.linalg.norm(np.diff(line, axis=0), axis=1)
    return CordLine(cord, np.asarray(line[np.concatenate([[True], apart > 1e-6])]))
