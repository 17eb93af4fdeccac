"""`study.html`: what came of a study, on one page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ....core.schema.types import is_number
from ....report.html import as_image, write_page
from ..points.measures import meaning
from ..runs.run_log import RunRecord
from . import figures
from .pareto import aspects
from .sensitivity import LEAST, Sensitivity, Sobol
from .study_table import StudyTable

PAGE = "study.html"
_SHOWN = 15  # of the best runs, before the table of all


def write_study_page(
    path: Path,
    table: StudyTable,
    front: Sequence[RunRecord],
    found: Sequence[Sensitivity],
    sobol: Sobol | None,
) -> None:
    """Raises StorageError."""
    measure = table.study.minimise or table.study.record[0]
    varied = [k for k in table.keys if len({repr(r.parameters.get(k)) for r in table.rows}) > 1]
    pictures = [
        (key, as_image(figures.against(table, key, measure))) for key in varied if table.done
    ]
    if front:
        pictures.append(("Pareto front", as_image(figures.pareto(table, front))))
    write_page(
        path,
        "study",
        table=table,
        measure=measure,
        meaning={name: meaning(name) for name in table.study.record},
        keys=varied,
        shown=_SHOWN,
        pictures=pictures,
        front=front,
        aspects=aspects(table),
        sensitivities=found,
        sobol=sobol,
        least=LEAST,
        failures=failures(table.failed),
        costs=_costs(table),
        text=text,
    )


def failures(rows: Sequence[RunRecord]) -> list[tuple[str, list[RunRecord]]]:
    """Runs that failed with the same message together, the most frequent first."""
    groups: dict[str, list[RunRecord]] = {}
    for row in rows:
        groups.setdefault(row.message, []).append(row)
    return sorted(groups.items(), key=lambda g: -len(g[1]))


def text(value: Any) -> str:
    """A value as it stands in tables."""
    if value is None:
        return "–"
    return f"{value:.4g}" if is_number(value) and not isinstance(value, int) else str(value)


def _costs(table: StudyTable) -> dict[str, float]:
    """Of all runs: CPU seconds together, largest memory (MB), bytes to and fro."""
    costs = [r.cost for r in table.rows]
    return {
        "cpu": sum(c.cpu for c in costs),
        "memory": max((c.memory for c in costs), default=0.0),
        "sent": sum(c.sent for c in costs),
        "returned": sum(c.returned for c in costs),
    }
