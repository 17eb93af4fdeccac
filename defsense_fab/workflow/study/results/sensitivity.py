"""Sensitivity of a measure to the parameters of a study: rank statistics and Sobol indices.

Rank statistics need no model. Spearman's coefficient measures a monotonic relation. The share is
the part of the ranks' variance between groups of equal values (choices and integers) or tenths
(drawn numbers), corrected for chance (epsilon squared of Kruskal and Wallis), so that it is near 0
for a parameter without effect.
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

#: Smallest number of runs for a sensitivity.
MIN_RUNS = 8
MAX_GROUPS, MIN_GROUP_RUNS = 10, 4
#: Smallest share of the variance of left-out runs that the surface must predict for indices.
MIN_PREDICTED = 0.8
SOBOL_SAMPLES = 1024


@dataclass(frozen=True)
class Sensitivity:
    """The sensitivity to a parameter.

    Attributes:
        key: Key of the parameter.
        rho: Spearman's coefficient; None for choices.
        p_value: Its p value; None for choices.
        share: Share of the ranks' variance between groups; None for too few runs.
    """

    key: str
    rho: float | None
    p_value: float | None
    share: float | None


@dataclass(frozen=True)
class Sobol:
    """Sobol indices of a surface of second degree.

    Attributes:
        keys: Keys of the drawn parameters.
        first: First-order indices.
        total: Total indices.
        predicted: Share of the variance of left-out runs that the surface predicts.
    """

    keys: tuple[str, ...]
    first: tuple[float, ...]
    total: tuple[float, ...]
    predicted: float


def compute_sensitivities(table: StudyTable, measure: str) -> list[Sensitivity]:
    """Return the sensitivities to all parameters that vary, the largest first.

    There are none for fewer than `MIN_RUNS` successful runs.
    """
    rows, values = _measured(table, measure)
    if len(rows) < MIN_RUNS or np.ptp(values) == 0:
        return []
    results = []
    for parameter in table.study.parameters:
        column = [r.parameters[parameter.key] for r in rows]
        if any(v != column[0] for v in column):
            results.append(_compute_sensitivity(parameter.key, column, values))
    return sorted(results, key=lambda s: -(s.share if s.share is not None else abs(s.rho or 0.0)))


def _measured(table: StudyTable, measure: str) -> tuple[list[RunRecord], Float]:
    rows = [r for r in table.done if is_number(r.measures.get(measure))]
    return rows, np.array([r.measures[measure] for r in rows], dtype=float)


def _compute_sensitivity(key: str, column: list[Any], values: Float) -> Sensitivity:
    from scipy.stats import rankdata, spearmanr

    rho = p_value = None
    if is_numeric(column):
        correlation = spearmanr(np.array(column, dtype=float), values)
        rho, p_value = float(correlation.statistic), float(correlation.pvalue)
    return Sensitivity(key, rho, p_value, _variance_share(_number_groups(column), rankdata(values)))


def _number_groups(column: Sequence[Any]) -> list[int]:
    """Return the group of each value: of equal values, or tenths if few values are equal."""
    different: list[Any] = []
    for value in column:
        if value not in different:
            different.append(value)
    if len(different) * MIN_GROUP_RUNS <= len(column) or not is_numeric(different):
        return [different.index(v) for v in column]
    count = max(2, min(MAX_GROUPS, len(column) // MIN_GROUP_RUNS))
    order = np.argsort(np.argsort(np.array(column, dtype=float), kind="stable"), kind="stable")
    return [int(k) for k in order * count // len(column)]


def _variance_share(groups: list[int], ranks: Float) -> float | None:
    """Return the corrected share of the ranks' variance between groups."""
    labels = np.array(groups)
    count, kinds = len(labels), len(set(groups))
    if count <= kinds:
        return None
    between = sum(
        (labels == g).sum() * (ranks[labels == g].mean() - ranks.mean()) ** 2 for g in set(groups)
    )
    h = (count - 1) * between / ((ranks - ranks.mean()) ** 2).sum()
    return float(max(0.0, (h - kinds + 1) / (count - kinds)))


def compute_sobol(table: StudyTable, measure: str) -> Sobol | None:
    """Return Sobol indices of a Latin hypercube.

    The result is None for other designs, for too few runs, if runs failed, and if a surface of
    second degree predicts less than `MIN_PREDICTED` of the variance of left-out runs.
    """
    from scipy.stats import sobol_indices, uniform

    drawn = table.study.parameters
    rows, values = _measured(table, measure)
    if table.study.design != "latin-hypercube" or any(p.bounds is None for p in drawn):
        return None
    # If points failed, the others do not represent the distributions.
    if table.failed or len(rows) < 2 * _terms(np.zeros((1, len(drawn)))).shape[1]:
        return None
    shares = np.array([[_to_share(p, r.parameters[p.key]) for p in drawn] for r in rows])
    columns = _terms(shares)
    q, _ = np.linalg.qr(columns)
    residual = values - q @ (q.T @ values)
    left_out = residual / np.maximum(1 - (q**2).sum(1), 1e-9)
    spread = float(((values - values.mean()) ** 2).sum())
    predicted = 1 - float((left_out**2).sum()) / spread if spread else 0.0
    if predicted < MIN_PREDICTED:
        return None
    weights = np.linalg.lstsq(columns, values, rcond=None)[0]
    indices = sobol_indices(
        func=lambda x: _terms(x.T) @ weights,
        n=SOBOL_SAMPLES,
        dists=[uniform()] * len(drawn),
        rng=np.random.default_rng(1),
    )
    first, total = (
        tuple(float(np.clip(v, 0, 1)) for v in np.atleast_1d(x))
        for x in (indices.first_order, indices.total_order)
    )
    return Sobol(tuple(p.key for p in drawn), first, total, predicted)


def _to_share(parameter: Parameter, value: float) -> float:
    """Return the share of the distribution below a value."""
    assert parameter.bounds is not None
    low, high = parameter.bounds
    if parameter.logarithmic:
        return float(np.log(value / low) / np.log(high / low))
    return (value - low) / (high - low)


def _terms(shares: Float) -> Float:
    """Return the terms (n, 1 + d + d(d+1)/2) of second degree of numbers (n, d)."""
    x = 2 * shares - 1
    i, j = np.triu_indices(x.shape[1])
    return np.hstack([np.ones((len(x), 1)), x, x[:, i] * x[:, j]])
