"""The Pareto front: runs than which none is better in one respect and no worse in the others."""

from __future__ import annotations

import numpy as np

from ....core.arrays import Bool, Float
from ....core.schema.types import is_number
from ..runs.run_log import RunRecord
from .study_table import StudyTable

#: What one would have little of, as far as it was recorded.
ASPECTS = ("error", "parts", "cords")


def front(values: Float) -> Bool:
    """Which rows (n,) of values (n, k), all to be small, no other row dominates; equal rows are on
    it together."""
    out = np.ones(len(values), bool)
    for i, row in enumerate(values):
        out[i] = not ((values <= row).all(1) & (values < row).any(1)).any()
    return out


def best_compromises(table: StudyTable) -> list[RunRecord]:
    """The runs on the front of the recorded aspects, by their first one; none where fewer than two
    aspects were recorded."""
    names = aspects(table)
    rows = [r for r in table.done if all(is_number(r.measures.get(n)) for n in names)]
    if len(names) < 2 or not rows:
        return []
    values = np.array([[r.measures[n] for n in names] for r in rows], dtype=float)
    return [r for r, on in zip(rows, front(values), strict=True) if on]


def aspects(table: StudyTable) -> list[str]:
    """Those that were recorded."""
    return [name for name in ASPECTS if name in table.study.record]
