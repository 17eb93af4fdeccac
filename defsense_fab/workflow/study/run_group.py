"""Groups of runs that share their simulation, each in its own process."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from ...core.errors import StudyError
from ...core.machine.child_process import ChildFailure, ChildLimits, run_module
from ...core.storage.files import storage_errors
from ..build.cluster import cancellation_check
from .plan import Run
from .run_log import RunRecord, read_records
from .run_process import DEVICE, DONE, RECORDS, TASK

RUN_MODULE = f"{__package__}.run_process"
_FAILURE = ChildFailure(
    StudyError,
    "",
    "the run's process",
    "Use a larger [mesh] edge_length, or fewer workers for each machine",
    "Raise time_limit in study.toml",
)


@dataclass(frozen=True)
class GroupTask:
    """A group of runs.

    Attributes:
        runs: The runs.
        text: Text of `device.toml`.
        until: The last stage of the runs.
        time_limit: Time limit of a run, s.
        threads: Threads of a run; None for the default.
    """

    runs: tuple[Run, ...]
    text: str
    until: str
    time_limit: float
    threads: int | None = None


class Stopped(Exception):
    """A group was stopped."""


def run_group(
    task: GroupTask,
    files: Mapping[str, bytes],
    report: Callable[[RunRecord], None] = lambda _: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> list[RunRecord]:
    """Make the runs of a group in a copy of the device's folder, where later runs reuse stages.

    A run is broken if its process ends unexpectedly or takes too long; the others continue in a
    new process.

    Args:
        task: The runs.
        files: The device's files by path.
        report: Called with each record within seconds.
        is_stopped: Whether the group should stop.

    Returns:
        The records.

    Raises:
        Stopped: Within seconds after `is_stopped` is true.
        StorageError: Files cannot be written.
    """
    records: list[RunRecord] = []
    with tempfile.TemporaryDirectory(prefix="defsense-study-") as name:
        folder = Path(name)
        with storage_errors(folder):
            (folder / RECORDS).touch()
            for path, data in files.items():
                (folder / DEVICE / path).parent.mkdir(parents=True, exist_ok=True)
                (folder / DEVICE / path).write_bytes(data)

        def add(record: RunRecord) -> None:
            records.append(record)
            report(record)

        def collect() -> None:
            for record in read_records(folder / RECORDS):
                if record.run not in {r.run for r in records}:
                    add(record)
            if is_stopped():
                raise Stopped

        while len(records) < len(task.runs):
            remaining = task.runs[len(records) :]
            problem = _run_process(replace(task, runs=remaining), folder, collect)
            collect()
            if problem and len(records) == len(task.runs) - len(remaining):
                run = remaining[0]
                add(RunRecord(run.name, run.values, "broken", problem))
    return records


def run_on_worker(task: GroupTask, files: Mapping[str, bytes]) -> list[RunRecord]:
    """Make the runs of a group on a worker of a cluster, until the client cancels them.

    Args:
        task: The runs.
        files: The device's files by path.
    """
    return run_group(task, files, is_stopped=cancellation_check())


def _run_process(task: GroupTask, folder: Path, on_wait: Callable[[], None]) -> str:
    """Return the problem that ended the process of these runs; empty if there is none."""

    def write_task(into: Path) -> None:
        description = {**asdict(task), "folder": str(folder)}
        (into / TASK).write_text(json.dumps(description), encoding="utf-8")

    try:
        with run_module(
            RUN_MODULE, write_task, DONE, ChildLimits(math.inf), _FAILURE, on_wait=on_wait
        ):
            return ""
    except StudyError as error:
        return str(error)
