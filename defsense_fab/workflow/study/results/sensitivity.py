"""Which parameters matter: ranks of the measure against each parameter, and Sobol indices where the
runs bear them.

Ranks ask for no model. Spearman's coefficient is that of a monotone relation; the share is that of
the ranks' variance between groups of equal values (choices and whole numbers) or tenths (numbers
that were drawn), with what chance alone would give taken off (epsilon squared of Kruskal and
Wallis), so that it is near 0 for a parameter that does nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ....core.arrays import Float
from ....core.schema.types import is_number
from ..points.parameters import Parameter, is_numeric
from ..runs.run_log import RunRecord
from .study_table import StudyTable

#: Runs without which nothing is said.
LEAST = 8
_GROUPS, _IN_GROUP = 10, 4
#: Share of the variance that the surface must predict of runs left out, before indices are told.
TRUSTED = 0.8
_SAMPLES = 1024


@dataclass(frozen=True)
class Sensitivity:
    """Of a parameter: Spearman's coefficient and its p value (None: it is a choice), and the share
    of the ranks' variance that goes with it (None: too few runs in groups)."""

    key: str
    rho: float | None
    p_value: float | None
    share: float | None


@dataclass(frozen=True)
class Sobol:
    """First-order and total indices of the drawn parameters, of a surface of second degree that
    predicts `predicted` of the variance of runs left out one by one."""

    keys: tuple[str, ...]
    first: tuple[float, ...]
    total: tuple[float, ...]
    predicted: float


def sensitivities(table: StudyTable, measure: str) -> list[Sensitivity]:
    """Of all parameters that vary among the runs that are done, the largest share first; none with
    fewer than LEAST runs."""
    rows, values = _measured(table, measure)
    if len(rows) < LEAST or np.ptp(values) == 0:
        return []
    found = []
    for parameter in table.study.parameters:
        column = [r.parameters[parameter.key] for r in rows]
        if any(v != column[0] for v in column):
            found.append(_one(parameter.key, column, values))
    return sorted(found, key=lambda s: -(s.share if s.share is not None else abs(s.rho or 0.0)))


def _measured(table: StudyTable, measure: str) -> tuple[list[RunRecord], Float]:
    rows = [r for r in table.done if is_number(r.measures.get(measure))]
    return rows, np.array([r.measures[measure] for r in rows], dtype=float)


def _one(key: str, column: list[Any], values: Float) -> Sensitivity:
    from scipy.stats import rankdata, spearmanr

    rho = p_value = None
    if is_numeric(column):
        found = spearmanr(np.array(column, dtype=float), values)
        rho, p_value = float(found.statistic), float(found.pvalue)
    return Sensitivity(key, rho, p_value, _share(_groups(column), rankdata(values)))


def _groups(column: Sequence[Any]) -> list[int]:
    """A group's number for each value: equal ones together, or tenths where few are equal."""
    different: list[Any] = []
    for value in column:
        if value not in different:
            different.append(value)
    if len(different) * _IN_GROUP <= len(column) or not is_numeric(different):
        return [different.index(v) for v in column]
    count = max(2, min(_GROUPS, len(column) // _IN_GROUP))
    order = np.argsort(np.argsort(np.array(column, dtype=float), kind="stable"), kind="stable")
    return [int(k) for k in order * count // len(column)]


def _share(groups: list[int], ranks: Float) -> float | None:
    labels = np.array(groups)
    count, kinds = len(labels), len(set(groups))
    if count <= kinds:
        return None
    between = sum(
        (labels == g).sum() * (ranks[labels == g].mean() - ranks.mean()) ** 2 for g in set(groups)
    )
    h = (count - 1) * between / ((ranks - ranks.mean()) ** 2).sum()
    return float(max(0.0, (h - kinds + 1) / (count - kinds)))


def sobol(table: StudyTable, measure: str) -> Sobol | None:
    """Indices of a Latin hypercube of numbers drawn from distributions; None for other designs,
    with too few runs, with runs that failed, and where a surface of second degree predicts less
    than TRUSTED of the variance of runs left out."""
    from scipy.stats import sobol_indices, uniform

    drawn = table.study.parameters
    rows, values = _measured(table, measure)
    if table.study.design != "latin-hypercube" or any(p.bounds is None for p in drawn):
        return None
    # Without the points that failed, the others are no sample of the distributions.
    if table.failed or len(rows) < 2 * _terms(np.zeros((1, len(drawn)))).shape[1]:
        return None
    shares = np.array([[_place(p, r.parameters[p.key]) for p in drawn] for r in rows])
    columns = _terms(shares)
    q, _ = np.linalg.qr(columns)
    residual = values - q @ (q.T @ values)
    left_out = residual / np.maximum(1 - (q**2).sum(1), 1e-9)
    spread = float(((values - values.mean()) ** 2).sum())
    predicted = 1 - float((left_out**2).sum()) / spread if spread else 0.0
    if predicted < TRUSTED:
        return None
    weights = np.linalg.lstsq(columns, values, rcond=None)[0]
    found = sobol_indices(
        func=lambda x: _terms(x.T) @ weights,
        n=_SAMPLES,
        dists=[uniform()] * len(drawn),
        rng=np.random.default_rng(1),
    )
    first, total = (
        tuple(float(np.clip(v, 0, 1)) for v in np.atleast_1d(x))
        for x in (found.first_order, found.total_order)
    )
    return Sobol(tuple(p.key for p in drawn), first, total, predicted)


def _place(parameter: Parameter, value: float) -> float:
    """The share of the distribution below a value."""
    assert parameter.bounds is not None
    low, high = parameter.bounds
    if parameter.logarithmic:
        return float(np.log(value / low) / np.log(high / low))
    return (value - low) / (high - low)


def _terms(shares: Float) -> Float:
    """(n, d) to (n, 1 + d + d(d+1)/2): one, the numbers, their products."""
    x = 2 * shares - 1
    i, j = np.triu_indices(x.shape[1])
    return np.hstack([np.ones((len(x), 1)), x, x[:, i] * x[:, j]])
