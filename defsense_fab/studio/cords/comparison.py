"""What cords give beside each other: markdown of what two sense, and what is lost without one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.device.device import Sensor
from ...optimize.prediction.layout_judge import Judged, LayoutJudge
from ..workbench.table_cell import table_cell

#: Of two cords' signals over the states: above, one tells hardly anything that the other does not.
_ALIKE = 0.95


def comparison(
    judge: LayoutJudge, sensors: Sequence[Sensor], judged: Judged, chosen: str, other: str
) -> str:
    """The table of two cords by name: the error without each, their largest signals, and how far
    one follows the other over all states."""
    names = [s.name for s in sensors]
    rows = [names.index(chosen), names.index(other)]
    without = [_without(judge, sensors, judged, k) for k in rows]
    signals = judged.signals[:, rows]
    largest = np.abs(signals).max(axis=0)
    lines = [
        f"| | {table_cell(chosen)} | {table_cell(other)} |",
        "|---|---:|---:|",
        f"| error without it | {without[0]} | {without[1]} |",
        f"| largest signal | {100 * largest[0]:.1f} % | {100 * largest[1]:.1f} % |",
    ]
    alike = _correlation(signals)
    told = f"Their signals go together by {alike:+.2f} (1: the same)."
    if abs(alike) > _ALIKE:
        told += " One of them tells hardly anything new."
    return "\n".join([*lines, "", told])


def _without(judge: LayoutJudge, sensors: Sequence[Sensor], judged: Judged, k: int) -> str:
    left = [s for n, s in enumerate(sensors) if n != k]
    found = judge.judge(left, quick=True)
    if found is None:
        return "no cord is left"
    return f"{found.error:.2f} mm ({found.error - judged.error:+.2f})"


def _correlation(signals: np.ndarray) -> float:
    """Of two columns; 0 where one is constant."""
    off = signals - signals.mean(axis=0)
    sizes = np.linalg.norm(off, axis=0)
    if not sizes.all():
        return 0.0
    return float(off[:, 0] @ off[:, 1] / sizes.prod())
