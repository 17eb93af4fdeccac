"""Parameter studies of a device: run the missing runs of `study.toml`, and write the results."""

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
from .results.sensitivity import Sensitivity, Sobol, compute_sensitivities, compute_sobol
from .results.study_page import PAGE, write_study_page
from .results.study_table import StudyTable, check_table_owner, find_compromises, write_table
from .runs.execution import make_runs
from .runs.planning import Plan, plan_runs
from .runs.run_log import FOLDER, RunLog, RunRecord
from .runs.worker import installed_versions

#: `device.toml` with the values of the best run.
BEST = "best.toml"


@dataclass(frozen=True)
class StudyResult:
    """The results of a study.

    Attributes:
        table: All runs.
        front: Runs of the Pareto front.
        sensitivities: Sensitivities of the first measure to the parameters.
        sobol: Sobol indices; None if the design does not allow them.
        made: Number of runs that were made now.
        file: File of the table.
        page: File of the page.
        best: `device.toml` with the values of the best run; None if no measure is minimized.
    """

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
    """Run the study that `study.toml` describes.

    Results are written to `study/` next to `device.toml`. Runs in the log are not repeated.

    Args:
        folder: Folder of the device.
        fixed: Values by dotted key that are fixed for all runs.
        workers: Number of processes on this machine.
        scheduler: Address of a cluster's scheduler; None for this machine.
        progress: Called with the progress.

    Raises:
        DeviceError: `study.toml` is invalid.
        StudyError: The files belong to another study, the cluster cannot be used, or all runs fail
            (`all-runs-failed`), in which case they are in the results.
    """
    study = load_study(folder)
    plan = plan_runs(folder, study, fixed, progress)
    name = _device_name(plan, folder)
    check_table_owner(folder, name)
    with RunLog(folder) as log:
        before = {r for r, record in log.records.items() if record.outcome != "broken"}
        try:
            make_runs(plan, study, log, workers, scheduler, progress)
        except BaseException:
            if any(r.name in log.records for r in plan.runs):
                _write_results(folder, name, study, plan, log, 0)
            raise
        made = sum(r.name not in before for r in plan.runs)
        result = _write_results(folder, name, study, plan, log, made)
    if not result.table.done:
        first = result.table.failed[0]
        raise StudyError(
            f"none of its {len(plan.runs)} runs succeeded; the first: {first.message}",
            code="all-runs-failed",
            where="study.toml",
            action=f"See all runs in {result.page}",
            runs=len(plan.runs),
        )
    progress("study", 1.0, "done")
    return result


def _device_name(plan: Plan, folder: Path) -> str:
    run = next(r for r in plan.runs if not r.problem)
    return studied_device(plan.text, folder, run.values).name


def _write_results(
    folder: Path, name: str, study: Study, plan: Plan, log: RunLog, made: int
) -> StudyResult:
    # The same device may be the result of other parameters in an earlier study.
    rows = tuple(
        replace(log.records[r.name], parameters=r.values)
        for r in plan.runs
        if r.name in log.records
    )
    table = StudyTable(name, study, rows, len(plan.runs), plan.points, installed_versions())
    best = folder / FOLDER / BEST if study.minimise and table.done else None
    measure = study.minimise or study.record[0]
    result = StudyResult(
        table,
        tuple(find_compromises(table)),
        tuple(compute_sensitivities(table, measure)),
        compute_sobol(table, measure),
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
