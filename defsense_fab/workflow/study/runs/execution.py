"""Execution of the missing runs of a plan, on this machine or on a cluster."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait

from ....core.progress import Progress
from ....mechanics.elements.threads import count_cores
from ..points.study_toml import Study
from .batch import Batch, ReportRecord, run_batch
from .planning import Plan, Run, group_runs
from .run_log import RunLog, RunRecord


def run_here(batches: Sequence[Batch], files: bytes, workers: int, report: ReportRecord) -> None:
    """Make batches of runs in processes of this machine.

    After an interruption or an error, all processes end within seconds.

    Args:
        batches: The batches.
        files: The device's files.
        workers: Number of batches at a time.
        report: Called with each record, one at a time, as soon as it is known.
    """
    stop, lock = threading.Event(), threading.Lock()

    def report_one(record: RunRecord) -> None:
        with lock:
            report(record)

    with ThreadPoolExecutor(workers, thread_name_prefix="study") as pool:
        futures = [pool.submit(run_batch, b, files, report_one, stop.is_set) for b in batches]
        try:
            done, _ = wait(futures, return_when=FIRST_EXCEPTION)
            for future in done:
                future.result()
        finally:
            stop.set()
            for future in futures:
                future.cancel()


def threads_per_run(workers: int) -> int:
    """Return the number of threads of a run, so that all runs together use all cores."""
    return max(1, count_cores() // workers)


MINUTES_FROM_S, HOURS_FROM_S = 90, 5400  # longer times are reported in minutes, and in hours
#: Largest number of runs of a batch on a cluster, which are lost together with their worker.
MAX_CLUSTER_BATCH = 20


def make_runs(
    plan: Plan,
    study: Study,
    log: RunLog,
    workers: int,
    scheduler: str | None,
    progress: Progress,
) -> None:
    """Make the runs of a plan that the log does not have, and those that were broken.

    After an error or an interruption the log has all finished runs.

    Args:
        plan: The runs.
        study: The study.
        log: Receives the records.
        workers: Number of processes on this machine.
        scheduler: Address of a cluster's scheduler; None for this machine.
        progress: Called with the progress.

    Raises:
        StudyError: The cluster cannot be used.
        StorageError: Files cannot be written.
    """
    for run in plan.runs:
        if run.problem:
            log.add(RunRecord(run.name, run.values, "refused", run.problem))
    missing = [r for r in plan.runs if _is_missing(log, r)]
    if not missing:
        return
    tracker = _Tracker(log, len(plan.runs), len(missing), progress)
    if scheduler is None:
        workers = min(workers, len(missing))
        jobs = [
            _make_batch(b, plan, study, threads_per_run(workers))
            for b in group_runs(missing, workers)
        ]
        tracker.report()
        run_here(jobs, plan.files.archive, workers, tracker.add)
        return
    from .cluster import connect, count_threads, run_on_cluster

    progress("study", 0.0, f"looking for workers at {scheduler}")
    with connect(scheduler) as client:
        jobs = [
            _make_batch(b, plan, study, None)
            for b in group_runs(missing, count_threads(client), MAX_CLUSTER_BATCH)
        ]
        tracker.report()
        run_on_cluster(client, jobs, plan.files.archive, tracker.add, tracker.report)


def _is_missing(log: RunLog, run: Run) -> bool:
    record = log.records.get(run.name)
    return record is None or record.outcome == "broken"


def _make_batch(runs: Sequence[Run], plan: Plan, study: Study, threads: int | None) -> Batch:
    named = tuple((r.name, r.values) for r in runs)
    return Batch(named, plan.text, study.until, study.time_limit, threads)


class _Tracker:
    """Logs finished runs, and reports the progress of the study."""

    def __init__(self, log: RunLog, runs: int, missing: int, progress: Progress) -> None:
        self._log, self._runs, self._missing, self._progress = log, runs, missing, progress
        self._started_at, self._done, self._failed = time.monotonic(), 0, 0

    def add(self, record: RunRecord) -> None:
        """Log a finished run."""
        self._log.add(record)
        self._done += 1
        self._failed += record.outcome != "done"
        self.report()

    def report(self, note: str = "") -> None:
        """Report the progress with a note, or with the remaining time."""
        before = self._runs - self._missing
        done = min(before + self._done, self._runs)
        message = f"{done} of {self._runs} runs"
        if self._failed:
            message += f", {self._failed} failed"
        if note:
            message += f"; {note}"
        elif self._done:
            mean = (time.monotonic() - self._started_at) / self._done
            message += f", {format_remaining(mean * max(self._missing - self._done, 0))}"
        self._progress("study", done / self._runs, message)


def format_remaining(seconds: float) -> str:
    """Return the remaining time in words."""
    if seconds < MINUTES_FROM_S:
        return f"about {seconds:.0f} s left"
    if seconds < HOURS_FROM_S:
        return f"about {seconds / 60:.0f} min left"
    return f"about {seconds / 3600:.1f} h left"
