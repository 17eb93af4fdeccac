"""Batches of runs that share their simulation, each in its own process."""

from __future__ import annotations

import json
import socket
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ....core.errors import StudyError
from ....geometry.bodies.child_process import ChildFailure, run_module
from .planning import unpack
from .run_log import RunRecord, decode_record

#: Files of a batch's folder: the job and its results.
JOB, RECORDS, DONE, DEVICE_FOLDER = "job.json", "records.log", "done", "device"
_MODULE = f"{__package__}.make_runs"
_FAILURE = ChildFailure(
    StudyError,
    "",
    "the run's process",
    "Use a larger [mesh] edge_length, or fewer workers for each machine",
    "Raise time_limit in study.toml",
)


@dataclass(frozen=True)
class Batch:
    """A batch of runs; it is sent together with the device's files.

    Attributes:
        runs: Names and values of the runs.
        text: Text of `device.toml`.
        until: The last stage of the runs.
        time_limit: Time limit of a run, s.
        threads: Threads of a run; None for the default.
    """

    runs: tuple[tuple[str, Mapping[str, Any]], ...]
    text: str
    until: str
    time_limit: float
    threads: int | None = None


ReportRecord = Callable[[RunRecord], None]


class Stopped(Exception):
    """A batch was stopped."""


def run_batch(
    batch: Batch,
    files: bytes,
    report: ReportRecord | None = None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> list[RunRecord]:
    """Make the runs of a batch in their order.

    A run whose process ends unexpectedly, or takes too long, is broken; the others continue in a
    new process.

    Args:
        batch: The runs.
        files: The device's files (see `pack`).
        report: Called with each record as soon as it is known.
        is_stopped: Whether the batch should stop.

    Returns:
        The records.

    Raises:
        Stopped: Within seconds after `is_stopped` is true.
        StorageError: Files cannot be written.
    """
    with tempfile.TemporaryDirectory(prefix="defsense-study-") as name:
        work = Path(name)
        unpack(files, work / DEVICE_FOLDER)
        reader = _RecordReader(work / RECORDS, batch, report, is_stopped)
        sent = len(files) // len(batch.runs) + len(batch.text)
        reader.sent = sent
        while len(reader.records) < len(batch.runs):
            remaining = batch.runs[len(reader.records) :]
            job = {**asdict(replace(batch, runs=remaining)), "work": name}
            reader.started_at = time.monotonic()
            problem = _run_process(job, reader)
            reader.read()
            if problem and len(reader.records) < len(batch.runs):
                run, values = batch.runs[len(reader.records)]
                reader.add(RunRecord(run, values, "broken", problem, worker=machine_name()))
        return reader.records


def _run_process(job: Mapping[str, Any], reader: _RecordReader) -> str:
    """Return the problem that ended the process; empty if there is none."""
    try:
        with run_module(
            _MODULE,
            lambda folder: _write_job(folder, job),
            DONE,
            float("inf"),
            _FAILURE,
            on_wait=reader.check,
        ):
            return ""
    except StudyError as error:
        return str(error)


def _write_job(folder: Path, job: Mapping[str, Any]) -> None:
    (folder / JOB).write_text(json.dumps(job), encoding="utf-8")


def machine_name() -> str:
    """Return the name of this machine."""
    return socket.gethostname()


class _RecordReader:
    """Reads the records of a batch while its process writes them.

    Attributes:
        records: The records.
        started_at: Start of the current run.
        sent: Bytes sent for a run.
    """

    def __init__(
        self, path: Path, batch: Batch, report: ReportRecord | None, is_stopped: Callable[[], bool]
    ) -> None:
        self._path, self._limit, self._report, self._is_stopped = (
            path,
            batch.time_limit,
            report,
            is_stopped,
        )
        self._position = self.sent = 0
        self.started_at = time.monotonic()
        self.records: list[RunRecord] = []

    def check(self) -> None:
        """Read new records; called every few seconds.

        Raises:
            Stopped: The batch should stop.
            StudyError: A run takes too long (`run-timed-out`).
        """
        self.read()
        if self._is_stopped():
            raise Stopped
        if time.monotonic() - self.started_at > self._limit:
            raise StudyError(
                f"the run did not end within {self._limit:g} s and was stopped",
                code="run-timed-out",
                action="Raise time_limit in study.toml",
                limit=self._limit,
            )

    def read(self) -> None:
        """Read new complete lines."""
        if not self._path.exists():
            return
        with self._path.open("rb") as file:
            file.seek(self._position)
            data = file.read()
        complete = data[: data.rfind(b"\n") + 1]
        self._position += len(complete)
        for line in complete.decode().splitlines():
            self.add(decode_record(line))

    def add(self, record: RunRecord) -> None:
        """Add the record of a finished run; the time of the next one starts."""
        record = record.with_bytes(self.sent)
        self.records.append(record)
        self.started_at = time.monotonic()
        if self._report is not None:
            self._report(record)
