"""The runs of a plan that are not there yet, made on this machine or on a cluster, and logged."""

from __future__ import annotations

import time
from collections.abc import Sequence

from ....core.progress import Progress
from ..points.study_toml import Study
from .batch import Batch
from .here import run_here, threads_each
from .planned import Plan, Run, batches
from .run_log import RunLog, RunRecord

#: From so many s on, times are told in minutes and in hours.
_MINUTES, _HOURS = 90, 5400
#: Runs of a batch on a cluster: they come back together, and are lost together with their worker.
LOST = 20


def make_runs(
    plan: Plan,
    study: Study,
    log: RunLog,
    workers: int,
    scheduler: str | None,
    progress: Progress,
) -> None:
    """Fill the `log` with the runs of a plan: what is there already stays, but for runs that were
    broken, which are made again.

    Raises StudyError where a cluster cannot be used, StorageError; what was done until then, or
    until an interruption, is in the log.
    """
    for run in plan.runs:
        if run.problem:
            log.add(RunRecord(run.name, run.values, "refused", run.problem))
    todo = [r for r in plan.runs if _is_to_do(log, r)]
    if not todo:
        return
    tracker = _Tracker(log, len(plan.runs), len(todo), progress)
    if scheduler is None:
        workers = min(workers, len(todo))
        jobs = [_batch(b, plan, study, threads_each(workers)) for b in batches(todo, workers)]
        tracker.say()
        run_here(jobs, plan.files.archive, workers, tracker.add)
        return
    from .cluster import connected, run_on_cluster, threads_there

    progress("study", 0.0, f"looking for workers at {scheduler}")
    with connected(scheduler) as client:
        jobs = [_batch(b, plan, study, None) for b in batches(todo, threads_there(client), LOST)]
        tracker.say()
        run_on_cluster(client, jobs, plan.files.archive, tracker.add, tracker.say)


def _is_to_do(log: RunLog, run: Run) -> bool:
    found = log.found.get(run.name)
    return found is None or (found.outcome == "broken")


def _batch(runs: Sequence[Run], plan: Plan, study: Study, threads: int | None) -> Batch:
    named = tuple((r.name, r.values) for r in runs)
    return Batch(named, plan.text, study.until, study.time_limit, threads)


class _Tracker:
    """Logs what is done, and says how far the study is."""

    def __init__(self, log: RunLog, runs: int, todo: int, progress: Progress) -> None:
        self._log, self._runs, self._todo, self._progress = log, runs, todo, progress
        self._begun, self._done, self._failed = time.monotonic(), 0, 0

    def add(self, record: RunRecord) -> None:
        """A run that is over."""
        self._log.add(record)
        self._done += 1
        self._failed += record.outcome != "done"
        self.say()

    def say(self, note: str = "") -> None:
        """With a note, or with the time that remains."""
        before = self._runs - self._todo
        done = min(before + self._done, self._runs)
        told = f"{done} of {self._runs} runs"
        if self._failed:
            told += f", {self._failed} failed"
        if note:
            told += f"; {note}"
        elif self._done:
            each = (time.monotonic() - self._begun) / self._done
            told += f", {remaining(each * max(self._todo - self._done, 0))}"
        self._progress("study", done / self._runs, told)


def remaining(seconds: float) -> str:
    """About how long it still takes, in words."""
    if seconds < _MINUTES:
        return f"about {seconds:.0f} s left"
    if seconds < _HOURS:
        return f"about {seconds / 60:.0f} min left"
    return f"about {seconds / 3600:.1f} h left"
