"""Pictures of a study: a measure against each parameter, the Pareto front."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ....core.arrays import Float
from ....core.schema.types import is_number
from ....report.pictures.sheet import COLORS
from ..points.measures import meaning
from ..points.parameters import is_numeric
from ..runs.run_log import RunRecord
from .pareto import aspects
from .study_table import StudyTable

_SPREAD = 0.12  # of points over a choice, to either side, in its width
_DECADE = 10.0  # beyond this ratio axes are logarithmic
_FEW = 3  # choices, whose names need not be turned
_UNITS = ("mm", "mm³", "degrees")


def against(table: StudyTable, key: str, measure: str) -> Any:
    """A matplotlib figure of a measure over a parameter: a point a run, and the medians where
    values come again."""
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
        beside = _SPREAD * (2 * np.random.default_rng(1).random(len(x)) - 1)
        axis.plot(x + beside, y, "o", color=COLORS[1], alpha=0.6, markeredgewidth=0)
        _medians(axis, x, y, "_")
        axis.set_xticks(range(len(labels)), labels, rotation=20 if len(labels) > _FEW else 0)
        axis.set_xlim(-0.5, len(labels) - 0.5)
    _scale(axis, y)
    axis.set(xlabel=key, ylabel=_labelled(measure))
    return figure


def _medians(axis: Any, x: Float, values: Float, mark: str) -> None:
    places = np.unique(x)
    if len(places) <= len(x) / 2:
        medians = [np.median(values[x == p]) for p in places]
        axis.plot(places, medians, mark, color=COLORS[0], ms=40, mew=2, label="median")
        axis.legend(loc="best", fontsize=8, markerscale=0.3)


def pareto(table: StudyTable, front: Sequence[RunRecord]) -> Any:
    """A matplotlib figure of the error over the last of the aspects, parts as colours."""
    figure, axis = _figure()
    names = aspects(table)
    across, up = names[-1], names[0]
    rows = [r for r in table.done if all(is_number(r.measures.get(n)) for n in names)]
    x, y = ([r.measures[n] for r in rows] for n in (across, up))
    colour = [r.measures[names[1]] for r in rows]
    shown = axis.scatter(x, y, c=colour, cmap="viridis", alpha=0.7, linewidths=0)
    if up != names[-2]:
        figure.colorbar(shown, ax=axis, label=names[1])
    on = [[r.measures[n] for n in (across, up)] for r in front]
    axis.plot(*np.array(on).T, "o", mfc="none", mec=COLORS[0], ms=11, mew=1.6, label="on the front")
    _scale(axis, np.array(y, dtype=float))
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.set(xlabel=across, ylabel=_labelled(up))
    axis.legend(loc="best", fontsize=8)
    return figure


def _labelled(measure: str) -> str:
    """With its unit."""
    unit = meaning(measure).rpartition(", ")[2]
    return f"{measure}, {unit}" if unit in _UNITS else measure


def _scale(axis: Any, values: Float) -> None:
    if _is_wide(values):
        axis.set_yscale("log")
    axis.grid(True, which="both", alpha=0.25)


def _is_wide(values: Float) -> bool:
    return len(values) > 0 and values.min() > 0 and values.max() > _DECADE * values.min()


def _figure() -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 3.8), dpi=120, layout="constrained")
    return figure, figure.subplots()
