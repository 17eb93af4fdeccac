"""A batch of runs, which share their simulation, in a process of its own: what a worker does."""

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
from .device_files import unpack
from .run_log import RunRecord, decoded

#: Files of a batch's folder: what to do, and what came of it.
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
    """What a worker is sent beside the device's files: runs as their names and values, the text of
    `device.toml`, the stage that they go to, the longest that a run may take (s), threads for
    each."""

    runs: tuple[tuple[str, Mapping[str, Any]], ...]
    text: str
    until: str
    time_limit: float
    threads: int | None = None


Tell = Callable[[RunRecord], None]


class Stopped(Exception):
    """Raised by a batch that was asked to stop."""


def run_batch(
    batch: Batch,
    files: bytes,
    tell: Tell | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> list[RunRecord]:
    """Make the runs, in their order, from the device's packed `files`. A run whose process ends
    without a word, or takes too long, is broken, and the others go on in a new process.

    Each record is told as it is there. Raises Stopped, within seconds of `stopped` being true;
    StorageError.
    """
    with tempfile.TemporaryDirectory(prefix="defsense-study-") as name:
        work = Path(name)
        unpack(files, work / DEVICE_FOLDER)
        following = _Following(work / RECORDS, batch, tell, stopped)
        sent = len(files) // len(batch.runs) + len(batch.text)
        following.sent = sent
        while len(following.records) < len(batch.runs):
            todo = batch.runs[len(following.records) :]
            job = {**asdict(replace(batch, runs=todo)), "work": name}
            following.since = time.monotonic()
            problem = _finished(job, following)
            following.read()
            if problem and len(following.records) < len(batch.runs):
                run, values = batch.runs[len(following.records)]
                following.add(RunRecord(run, values, "broken", problem, worker=place()))
        return following.records


def _finished(job: Mapping[str, Any], following: _Following) -> str:
    """The problem that ended the process, or none."""
    try:
        with run_module(
            _MODULE,
            lambda folder: _give(folder, job),
            DONE,
            float("inf"),
            _FAILURE,
            on_wait=following.look,
        ):
            return ""
    except StudyError as error:
        return str(error)


def _give(folder: Path, job: Mapping[str, Any]) -> None:
    (folder / JOB).write_text(json.dumps(job), encoding="utf-8")


def place() -> str:
    """This machine's name."""
    return socket.gethostname()


class _Following:
    """Reads the records of a batch while its process writes them."""

    def __init__(
        self, path: Path, batch: Batch, tell: Tell | None, stopped: Callable[[], bool]
    ) -> None:
        self._path, self._limit, self._tell, self._stopped = path, batch.time_limit, tell, stopped
        self._at = self.sent = 0
        self.since = time.monotonic()
        self.records: list[RunRecord] = []

    def look(self) -> None:
        """Every few seconds. Raises Stopped, and StudyError for a run that takes too long."""
        self.read()
        if self._stopped():
            raise Stopped
        if time.monotonic() - self.since > self._limit:
            raise StudyError(
                f"the run did not end within {self._limit:g} s and was stopped; raise time_limit in"
                " study.toml"
            )

    def read(self) -> None:
        """Whole lines that are new."""
        if not self._path.exists():
            return
        with self._path.open("rb") as file:
            file.seek(self._at)
            data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        self._at += len(whole)
        for line in whole.decode().splitlines():
            self.add(decoded(line))

    def add(self, record: RunRecord) -> None:
        """A run that is over; the next one's time begins."""
        record = record.told_bytes(self.sent)
        self.records.append(record)
        self.since = time.monotonic()
        if self._tell is not None:
            self._tell(record)
