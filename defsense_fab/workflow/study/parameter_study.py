"""Parameter studies of a device: make the missing runs of `study.toml`, and write the results.

The results are the ranked runs, the table `results.csv`, the picture `study.png`, and `best.toml`.
"""

from __future__ import annotations

import csv
import textwrap
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import StudyError
from ...core.progress import Progress, silent
from ...core.schema.types import is_number
from ...core.storage.files import replace_file, storage_errors, write_text
from ...mechanics.elements.threads import count_cores
from ..changed_values import changed_text
from .measures import describe_measure
from .options import StudyOptions
from .plan import Plan, Run, group_runs, plan_runs
from .run_group import GroupTask, run_group, run_on_worker
from .run_log import FOLDER, RunLog, RunRecord
from .study_file import Study, load_study

TABLE, PICTURE = "results.csv", "study.png"
MIN_RUNS = 8  # for rank correlations
MIN_LOG_RATIO = 10.0  # of the largest to the smallest value, for logarithmic axes
MAX_COLUMNS = 3  # of the picture
_COSTS = ("seconds", "cpu", "memory")
#: `device.toml` with the values of the best run.
BEST = "best.toml"
MAX_CLUSTER_GROUP = 20  # runs, which are lost together with their worker
_NO_OPTIONS = StudyOptions()


@dataclass(frozen=True)
class StudyRuns:
    """The finished runs of a study.

    Attributes:
        study: The study.
        rows: The finished runs, in the order of their points.
    """

    study: Study
    rows: tuple[RunRecord, ...]

    @property
    def done(self) -> list[RunRecord]:
        """The successful runs; the best first, if a measure is minimized."""
        rows, name = [r for r in self.rows if r.outcome == "done"], self.study.file.minimized
        return sorted(rows, key=lambda r: _sort_value(r.measures.get(name))) if name else rows

    @property
    def failures(self) -> dict[str, list[RunRecord]]:
        """The runs that did not succeed by message, the most frequent first."""
        groups: dict[str, list[RunRecord]] = {}
        for row in self.rows:
            if row.outcome != "done":
                groups.setdefault(row.message, []).append(row)
        return dict(sorted(groups.items(), key=lambda group: -len(group[1])))

    @property
    def correlations(self) -> dict[str, float]:
        """Spearman's coefficient of the measure with each numeric parameter, the largest first.

        It is near 1 or -1 where the measure rises or falls with the parameter, and near 0 where the
        parameter has no effect. There are none for fewer than `MIN_RUNS` runs.
        """
        from scipy.stats import spearmanr

        coefficients = {}
        for key in (p.key for p in self.study.parameters):
            x, y = self._measured(key)
            if len(x) >= MIN_RUNS and all(map(is_number, x)) and np.ptp(x) and np.ptp(y):
                coefficients[key] = float(spearmanr(x, y).statistic)
        return dict(sorted(coefficients.items(), key=lambda item: -abs(item[1])))

    def _measured(self, key: str) -> tuple[list[Any], list[float]]:
        """Return the values of a parameter and of the main measure in all runs that have it."""
        name = self.study.file.main_measure
        rows = [r for r in self.done if is_number(r.measures.get(name))]
        return [r.parameters.get(key) for r in rows], [r.measures[name] for r in rows]  # type: ignore[misc]

    def write_table(self, path: Path) -> None:
        """Write a row for each run, with its parameters, measures, costs and message.

        Raises:
            StorageError: The file cannot be written.
        """
        keys = dict.fromkeys(key for row in self.rows for key in row.parameters)
        measures = self.study.file.measures
        names = ["run", "outcome", *keys, *measures, *_COSTS, "worker", "message"]
        with replace_file(path) as part, part.open("w", encoding="utf-8", newline="") as out:
            writer = csv.DictWriter(out, names, extrasaction="ignore")
            writer.writeheader()
            writer.writerows({**r.parameters, **r.measures, **vars(r)} for r in self.rows)

    def draw(self, path: Path) -> None:
        """Draw the main measure over each parameter that varies, a point per run.

        Raises:
            StorageError: The file cannot be written.
        """
        from matplotlib.figure import Figure

        name = self.study.file.main_measure
        panels = {p.key: self._measured(p.key) for p in self.study.parameters}
        panels = {k: (x, y) for k, (x, y) in panels.items() if len({repr(v) for v in x}) > 1}
        columns = min(len(panels), MAX_COLUMNS) or 1
        rows = -(-len(panels) // columns) or 1
        figure = Figure(figsize=(5 * columns, 3.5 * rows), dpi=120, layout="constrained")
        for number, (key, (x, y)) in enumerate(panels.items(), 1):
            axis: Any = figure.add_subplot(rows, columns, number)
            is_numeric = all(map(is_number, x))
            axis.plot(x if is_numeric else [str(v) for v in x], y, "o", alpha=0.6)
            if is_numeric and _is_wide(x):
                axis.set_xscale("log")
            elif all(isinstance(value, int) for value in x):
                axis.xaxis.get_major_locator().set_params(integer=True)
            if _is_wide(y):
                axis.set_yscale("log")
            axis.set(xlabel=key, ylabel=name)
            axis.grid(True, which="both", alpha=0.25)
        text = textwrap.fill(f"{name}: {describe_measure(name)}", 60 * columns)
        figure.suptitle(text, fontsize=10)
        with replace_file(path) as part:
            figure.savefig(part)


def _sort_value(value: Any) -> float:
    return float(value) if is_number(value) else float("inf")


def _is_wide(values: Sequence[float]) -> bool:
    return min(values) > 0 and max(values) > MIN_LOG_RATIO * min(values)


def format_value(value: Any) -> str:
    """Return a value as text for tables."""
    if value is None:
        return "–"
    return f"{value:.4g}" if is_number(value) and not isinstance(value, int) else str(value)


@dataclass(frozen=True)
class StudyResult:
    """The results of a study.

    Attributes:
        runs: The finished runs.
        points: Number of points.
        new_runs: Number of runs that were made now.
        file: Table of all runs.
        picture: The main measure over each parameter.
        best: `device.toml` with the values of the best run; None if no measure is minimized.
    """

    runs: StudyRuns
    points: int
    new_runs: int
    file: Path
    picture: Path
    best: Path | None


def study_parameters(
    folder: Path,
    fixed: Mapping[str, Any],
    progress: Progress = silent,
    *,
    options: StudyOptions = _NO_OPTIONS,
) -> StudyResult:
    """Run the study that `study.toml` describes.

    Results are written to `study/` next to `device.toml`. Runs in the log are not repeated.

    Args:
        folder: Folder of the device.
        fixed: Values by dotted key that are fixed for all runs.
        progress: Called with the progress.
        options: Number of processes or cluster; `sensors` does not apply.

    Raises:
        StudyError: `study.toml` is invalid, the cluster cannot be used, or all runs fail
            (`all-runs-failed`), in which case they are in the results.
        CaptureError: The log belongs to another program, or another study is running.
    """
    study = load_study(folder)
    plan = plan_runs(folder, study, fixed, progress)
    with RunLog(folder) as log:
        missing = [r for r in plan.runs if log.is_missing(r.name)]
        try:
            _make_runs(missing, plan, study, log, options, progress)
        finally:
            result = _write_results(folder, study, plan, log, len(missing))
    if not result.runs.done:
        first = next(iter(result.runs.failures))
        raise StudyError(
            f"none of its {len(plan.runs)} runs succeeded; the first: {first}",
            code="all-runs-failed",
            where="study.toml",
            action=f"See all runs in {result.file}",
            runs=len(plan.runs),
        )
    progress("study", 1.0, "done")
    return result


def _make_runs(
    missing: Sequence[Run],
    plan: Plan,
    study: Study,
    log: RunLog,
    options: StudyOptions,
    progress: Progress,
) -> None:
    """Make runs on this machine or on a cluster; after an error the log has the finished ones."""
    lock, total = threading.Lock(), len(plan.runs)
    waiting = len(missing)

    def add(record: RunRecord) -> None:
        nonlocal waiting
        with lock:
            log.add(record)
            waiting -= 1
            progress("study", 1 - waiting / total, f"{total - waiting} of {total} runs")

    for run in missing:
        if run.problem:
            add(RunRecord(run.name, run.values, "refused", run.problem))
    missing = [r for r in missing if not r.problem]
    if not missing:
        return

    def tasks(groups: Sequence[tuple[Run, ...]], threads: int | None) -> list[GroupTask]:
        file = study.file
        return [GroupTask(g, plan.text, file.until, file.time_limit, threads) for g in groups]

    if options.scheduler is None:
        workers = min(options.workers or count_cores(), len(missing))
        threads = max(1, count_cores() // workers)  # all runs together use all cores
        groups, stop = group_runs(missing, workers), threading.Event()
        with ThreadPoolExecutor(workers, thread_name_prefix="study") as pool:
            futures = [
                pool.submit(run_group, task, plan.files, add, stop.is_set)
                for task in tasks(groups, threads)
            ]
            try:
                done, _ = wait(futures, return_when=FIRST_EXCEPTION)
                for future in done:
                    future.result()
            finally:  # after an interruption, all processes end within seconds
                stop.set()
                pool.shutdown(cancel_futures=True)
        return
    from ..build.cluster import connect, count_threads, map_on_cluster

    progress("study", 0.0, f"connecting to {options.scheduler}")
    with connect(options.scheduler) as client:
        groups = group_runs(missing, count_threads(client), MAX_CLUSTER_GROUP)
        for k, result in map_on_cluster(client, run_on_worker, tasks(groups, 1), plan.files):
            if isinstance(result, StudyError):
                result = [RunRecord(r.name, r.values, "broken", str(result)) for r in groups[k]]
            for record in result:
                add(record)


def _write_results(
    folder: Path, study: Study, plan: Plan, log: RunLog, new_runs: int
) -> StudyResult:
    # The same device may be the result of other parameters in an earlier study.
    rows = tuple(
        replace(log.records[r.name], parameters=r.values)
        for r in plan.runs
        if r.name in log.records
    )
    runs = StudyRuns(study, rows)
    file, picture, best = (folder / FOLDER / name for name in (TABLE, PICTURE, BEST))
    has_best = study.file.minimized is not None and bool(runs.done)
    with storage_errors(best):
        if has_best:
            changes = {run.name: run.changes for run in plan.runs}
            write_text(best, changed_text(plan.text, changes[runs.done[0].run]))
        else:
            best.unlink(missing_ok=True)
        runs.write_table(file)
        runs.draw(picture)
    return StudyResult(runs, plan.points, new_runs, file, picture, best if has_best else None)
