"""The page `study.html` of a study's results, which needs no other file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float
from ....core.schema.types import is_number
from ....report.html import as_image, write_page
from ....report.pictures.sheet import COLORS
from ..points.measures import describe_measure
from ..points.parameters import is_numeric
from ..runs.run_log import RunRecord
from .sensitivity import MIN_RUNS, Sensitivity, Sobol
from .study_table import StudyTable, recorded_aspects

POINT_SPREAD = 0.12  # of points of a choice, to either side, relative to its width
MIN_LOG_RATIO = 10.0  # of the largest to the smallest value, for logarithmic axes
MAX_LEVEL_LABELS = 3  # of choices; more labels are rotated
_UNITS = ("mm", "mm³", "degrees")


def draw_measure(table: StudyTable, key: str, measure: str) -> Any:
    """Draw a measure over a parameter: a point per run, and medians of repeated values.

    Returns:
        A matplotlib figure.
    """
    figure, axis = _figure()
    rows = [r for r in table.done if is_number(r.measures.get(measure))]
    column, values = [r.parameters.get(key) for r in rows], [r.measures[measure] for r in rows]
    y = np.array(values, dtype=float)
    if is_numeric(column):
        x = np.array(column, dtype=float)
        axis.plot(x, y, "o", color=COLORS[1], alpha=0.6, markeredgewidth=0)
        _medians(axis, x, y, "-")
        if _is_wide(x):
            axis.set_xscale("log")
        if (x == x.round()).all():
            axis.xaxis.get_major_locator().set_params(integer=True)
    else:
        labels = list(dict.fromkeys(str(v) for v in column))
        x = np.array([labels.index(str(v)) for v in column], dtype=float)
        offset = POINT_SPREAD * (2 * np.random.default_rng(1).random(len(x)) - 1)
        axis.plot(x + offset, y, "o", color=COLORS[1], alpha=0.6, markeredgewidth=0)
        _medians(axis, x, y, "_")
        axis.set_xticks(
            range(len(labels)), labels, rotation=20 if len(labels) > MAX_LEVEL_LABELS else 0
        )
        axis.set_xlim(-0.5, len(labels) - 0.5)
    _scale(axis, y)
    axis.set(xlabel=key, ylabel=_axis_label(measure))
    return figure


def _medians(axis: Any, x: Float, values: Float, mark: str) -> None:
    positions = np.unique(x)
    if len(positions) <= len(x) / 2:
        medians = [np.median(values[x == p]) for p in positions]
        axis.plot(positions, medians, mark, color=COLORS[0], ms=40, mew=2, label="median")
        axis.legend(loc="best", fontsize=8, markerscale=0.3)


def draw_pareto(table: StudyTable, front: Sequence[RunRecord]) -> Any:
    """Draw the first aspect over the last one, with the number of parts as color.

    Returns:
        A matplotlib figure.
    """
    figure, axis = _figure()
    names = recorded_aspects(table)
    across, up = names[-1], names[0]
    rows = [r for r in table.done if all(is_number(r.measures.get(n)) for n in names)]
    x, y = ([r.measures[n] for r in rows] for n in (across, up))
    color = [r.measures[names[1]] for r in rows]
    points = axis.scatter(x, y, c=color, cmap="viridis", alpha=0.7, linewidths=0)
    if up != names[-2]:
        figure.colorbar(points, ax=axis, label=names[1])
    on_front = [[r.measures[n] for n in (across, up)] for r in front]
    axis.plot(
        *np.array(on_front).T, "o", mfc="none", mec=COLORS[0], ms=11, mew=1.6, label="on the front"
    )
    _scale(axis, np.array(y, dtype=float))
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.set(xlabel=across, ylabel=_axis_label(up))
    axis.legend(loc="best", fontsize=8)
    return figure


def _axis_label(measure: str) -> str:
    """Return a measure with its unit."""
    unit = describe_measure(measure).rpartition(", ")[2]
    return f"{measure}, {unit}" if unit in _UNITS else measure


def _scale(axis: Any, values: Float) -> None:
    if _is_wide(values):
        axis.set_yscale("log")
    axis.grid(True, which="both", alpha=0.25)


def _is_wide(values: Float) -> bool:
    return len(values) > 0 and values.min() > 0 and values.max() > MIN_LOG_RATIO * values.min()


def _figure() -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 3.8), dpi=120, layout="constrained")
    return figure, figure.subplots()


PAGE = "study.html"
BEST_RUNS = 15  # shown before the table of all runs


def write_study_page(
    path: Path,
    table: StudyTable,
    front: Sequence[RunRecord],
    sensitivities: Sequence[Sensitivity],
    sobol: Sobol | None,
) -> None:
    """Write the page.

    Args:
        path: The file.
        table: The runs.
        front: Runs of the Pareto front.
        sensitivities: Sensitivities.
        sobol: Sobol indices; None if there are none.

    Raises:
        StorageError: The file cannot be written.
    """
    measure = table.study.minimise or table.study.record[0]
    varied = [k for k in table.keys if len({repr(r.parameters.get(k)) for r in table.rows}) > 1]
    pictures = [(key, as_image(draw_measure(table, key, measure))) for key in varied if table.done]
    if front:
        pictures.append(("Pareto front", as_image(draw_pareto(table, front))))
    write_page(
        path,
        "study",
        table=table,
        measure=measure,
        meaning={name: describe_measure(name) for name in table.study.record},
        keys=varied,
        shown=BEST_RUNS,
        pictures=pictures,
        front=front,
        aspects=recorded_aspects(table),
        sensitivities=sensitivities,
        sobol=sobol,
        least=MIN_RUNS,
        failures=group_failures(table.failed),
        costs=_costs(table),
        text=format_value,
    )


def group_failures(rows: Sequence[RunRecord]) -> list[tuple[str, list[RunRecord]]]:
    """Return the failed runs by message, the most frequent first."""
    groups: dict[str, list[RunRecord]] = {}
    for row in rows:
        groups.setdefault(row.message, []).append(row)
    return sorted(groups.items(), key=lambda g: -len(g[1]))


def format_value(value: Any) -> str:
    """Return a value as text for tables."""
    if value is None:
        return "–"
    return f"{value:.4g}" if is_number(value) and not isinstance(value, int) else str(value)


def _costs(table: StudyTable) -> dict[str, float]:
    """Return the total CPU time (s), the largest memory (MB) and the transferred bytes."""
    costs = [r.cost for r in table.rows]
    return {
        "cpu": sum(c.cpu for c in costs),
        "memory": max((c.memory for c in costs), default=0.0),
        "sent": sum(c.sent for c in costs),
        "returned": sum(c.returned for c in costs),
    }
