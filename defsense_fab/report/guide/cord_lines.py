"""Locate a cord in its device: its line, its ends and its ferrules."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths, resample
from ...store.layout import LayoutRecord
from ...store.manifest import CordStretch, CutCord

_MIN_POINT_DISTANCE_MM = 1e-6  # nearer points are the same


@dataclass(frozen=True)
class CordLine:
    """The line of a cord.

    Attributes:
        cord: Record of the cord.
        points: Points (p, 3) of its channel from mouth to mouth, mm.
    """

    cord: CutCord
    points: Float

    def way_out(self, end: int) -> Float:
        """Return the unit direction (3,) in which the cord leaves the body at an end."""
        p = self.points
        direction = p[0] - p[3] if end == 0 else p[-1] - p[-4]
        return np.asarray(direction / np.linalg.norm(direction))

    def ferrule(self, end: int, length: float) -> Float:
        """Return the middle (3,) of an end's ferrule, mm.

        A ferrule is at the bottom of its pocket, or outside the mouth of a free end.
        """
        record = self.cord.ends[end]
        depth = record.pocket - length / 2 if record.joint == "pocket" else -record.lead
        return np.asarray(record.at - depth * self.way_out(end))

    def along(self, start: float, stop: float, points_per_mm: float = 1.0) -> Float:
        """Return points (q, 3) of the line between two distances from its first mouth, mm."""
        stop = min(stop, float(arc_lengths(self.points)[-1]))
        count = max(2, int(points_per_mm * (stop - start)) + 1)
        return resample(self.points, start, stop, count)

    def ends_in(self, stretch: CordStretch) -> list[int]:
        """Return the ends of the cord that belong to a stretch."""
        last = len(self.cord.stretches) - 1
        return [end for end, k in ((0, 0), (1, last)) if self.cord.stretches[k] is stretch]


def cord_line(layout: LayoutRecord, cord: CutCord) -> CordLine:
    """Return the line of a cord in its layout."""
    points = next(s.points for s in layout.sensors if s.name == cord.sensor)
    line = np.concatenate([cord.ends[0].at[None], points, cord.ends[1].at[None]])
    distances = np.linalg.norm(np.diff(line, axis=0), axis=1)
    is_new = np.concatenate([[True], distances > _MIN_POINT_DISTANCE_MM])
    return CordLine(cord, np.asarray(line[is_new]))
