"""What a search for cords has come to so far."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ...core.arrays import Float
from ...optimize.prediction.layout_judge import Judged
from ..workbench.build_work import SeenLayout
from ..workbench.pose_errors import extremes
from ..workbench.table_cell import table_cell

_MOST = 1200  # points of the curve; every other one goes when there are more


@dataclass
class SearchRecord:
    """Of one build: the curve, as s of work, the error (mm) of the layout that was passed then and
    of the best until then; the `best` layout that keeps every limit, and what is expected of it."""

    best: SeenLayout | None = None
    judged: Judged | None = None
    _rows: list[tuple[float, float, float]] = field(default_factory=list)
    _begun: float = 0.0

    def add(self, seen: SeenLayout, judged: Judged | None) -> bool:
        """Whether it is the best so far; `judged` is None where nothing can be said of it."""
        if judged is None:
            return False
        better = seen.kept and (self.judged is None or judged.error < self.judged.error)
        if better:
            self.best, self.judged = seen, judged
        least = math.nan if self.judged is None else self.judged.error
        if not self._rows:
            self._begun = seen.seconds
        self._rows.append((seen.seconds - self._begun, judged.error, least))
        if len(self._rows) > _MOST:
            self._rows = self._rows[::2]
        return better

    @property
    def curve(self) -> tuple[Float, Float, Float]:
        """Seconds, errors on the way and least errors (n,), of which some may be unknown (NaN)."""
        rows = np.array(self._rows, float).reshape(-1, 3)
        return rows[:, 0].copy(), rows[:, 1].copy(), rows[:, 2].copy()


def pose_table(before: Mapping[str, float] | None, now: Mapping[str, float]) -> str:
    """Markdown: the error of each pose at its extreme, as drawn and now, of errors by state."""
    was = {} if before is None else extremes(before)
    rows = extremes(now)
    lines = ["| pose | as drawn | now |", "|---|---:|---:|"]
    for pose, mm in rows.items():
        drawn = f"{was[pose]:.2f}" if pose in was else "-"
        lines.append(f"| {table_cell(pose)} | {drawn} | **{mm:.2f}** mm |")
    return "\n".join(lines)
