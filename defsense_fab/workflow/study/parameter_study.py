"""A device's study by `study.toml`: its runs made where they are not there yet, its results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...core.errors import StudyError
from ...core.progress import Progress, silent
from ...core.storage.files import storage_errors, write_text
from .points.studied_device import studied_device, studied_text
from .points.study_toml import Study, load_study
from .results.pareto import best_compromises
from .results.sensitivity import Sensitivity, Sobol, sensitivities, sobol
from .results.study_page import PAGE, write_study_page
from .results.study_table import StudyTable, refuse_others, write_table
from .runs.making import make_runs
from .runs.planned import Plan, planned
from .runs.run_log import FOLDER, RunLog, RunRecord
from .runs.versions import installed

#: `device.toml` with the values of the best run.
BEST = "best.toml"


@dataclass(frozen=True)
class StudyResult:
    """The table of all runs, the Pareto front, the sensitivities; how many runs were `made` now;
    the files written (no `best` where no measure is to be small)."""

    table: StudyTable
    front: tuple[RunRecord, ...]
    sensitivities: tuple[Sensitivity, ...]
    sobol: Sobol | None
    made: int
    file: Path
    page: Path
    best: Path | None


def run_study(
    folder: Path,
    fixed: Mapping[str, Any],
    workers: int,
    scheduler: str | None = None,
    progress: Progress = silent,
) -> StudyResult:
    """Make the study of the device in a `folder` by its `study.toml`, with values of dotted keys
    that are `fixed` for all runs, in `workers` processes or on a cluster. Its results are in
    `study/` beside `device.toml`; runs that are in its log are not made again.

    Raises DeviceError for what is wrong in `study.toml`; StudyError for files of another study,
    clusters that cannot be used, and where all runs fail, which are then told in the files.
    """
    study = load_study(folder)
    plan = planned(folder, study, fixed, progress)
    name = _name(plan, folder)
    refuse_others(folder, name)
    with RunLog(folder) as log:
        before = {r for r, found in log.found.items() if found.outcome != "broken"}
        try:
            make_runs(plan, study, log, workers, scheduler, progress)
        except BaseException:
            if any(r.name in log.found for r in plan.runs):
                _results(folder, name, study, plan, log, 0)
            raise
        made = sum(r.name not in before for r in plan.runs)
        result = _results(folder, name, study, plan, log, made)
    if not result.table.done:
        first = result.table.failed[0]
        raise StudyError(
            f"study.toml: none of its {len(plan.runs)} runs succeeded; the first: {first.message};"
            f" {result.page} lists all"
        )
    progress("study", 1.0, "done")
    return result


def _name(plan: Plan, folder: Path) -> str:
    run = next(r for r in plan.runs if not r.problem)
    return studied_device(plan.text, folder, run.values).name


def _results(
    folder: Path, name: str, study: Study, plan: Plan, log: RunLog, made: int
) -> StudyResult:
    # A run of an earlier study of other parameters means the same device.
    rows = tuple(
        replace(log.found[r.name], parameters=r.values) for r in plan.runs if r.name in log.found
    )
    table = StudyTable(name, study, rows, len(plan.runs), plan.points, installed())
    best = folder / FOLDER / BEST if study.minimise and table.done else None
    measure = study.minimise or study.record[0]
    result = StudyResult(
        table,
        tuple(best_compromises(table)),
        tuple(sensitivities(table, measure)),
        sobol(table, measure),
        made,
        write_table(folder, table),
        folder / FOLDER / PAGE,
        best,
    )
    if best is not None:
        with storage_errors(best):
            write_text(best, studied_text(plan.text, table.done[0].parameters))
    else:
        with storage_errors(folder):
            (folder / FOLDER / BEST).unlink(missing_ok=True)
    write_study_page(result.page, table, result.front, result.sensitivities, result.sobol)
    return result
