"""The log `study/runs.log`: one line per run of a device's studies; lines are only appended."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import msgspec

from ....core.errors import CaptureError, StudyError
from ....core.storage.append_log import AppendLog, LogLines
from ....core.storage.files import storage_errors
from ..points.measures import Value

FOLDER, FILE = "study", "runs.log"
_HEADER = '{"log": "runs of defsense studies", "schema": 1}'

#: `done`; `refused` by the design itself, as it would be again; `broken` by other causes: memory,
#: time, a worker that died, a fault of the program.
Outcome = Literal["done", "refused", "broken"]


@dataclass(frozen=True)
class Cost:
    """The cost of a run.

    Attributes:
        seconds: Duration, s.
        cpu: CPU time of all its processes, s.
        shared_cpu: CPU time of the stages that the runs of its batch share (body, mesh, poses), s.
        memory: Peak memory of the process until its end, MB.
        sent: Bytes sent for it.
        returned: Bytes sent back.
    """

    seconds: float = 0.0
    cpu: float = 0.0
    shared_cpu: float = 0.0
    memory: float = 0.0
    sent: int = 0
    returned: int = 0


@dataclass(frozen=True)
class RunRecord:
    """The result of a run.

    Attributes:
        run: Hash of all inputs of the run.
        parameters: Values by dotted key of `device.toml`.
        outcome: Whether it succeeded.
        message: Why it did not succeed.
        measures: Measured values by name.
        cost: What it cost.
        worker: Machine on which it ran.
    """

    run: str
    parameters: Mapping[str, Any]
    outcome: Outcome
    message: str = ""
    measures: Mapping[str, Value] = field(default_factory=dict)
    cost: Cost = Cost()
    worker: str = ""

    def with_bytes(self, sent: int) -> RunRecord:
        """Return the record with the bytes sent for it, and its own."""
        return replace(self, cost=replace(self.cost, sent=sent, returned=len(encode_record(self))))


def encode_record(record: RunRecord) -> str:
    """Return a record as a line."""
    return msgspec.json.encode(record).decode()


def decode_record(line: str) -> RunRecord:
    """Return the record of a line.

    Raises:
        msgspec.DecodeError: The line is not a record.
    """
    return msgspec.json.decode(line, type=RunRecord)


class RunLog:
    """The log of a device's studies while one runs; a context manager.

    Args:
        device: Folder of the device.

    Attributes:
        path: The file.
        records: The records by run.

    Raises:
        StudyError: The file is not such a log (`not-a-study-log`, `record-invalid`), or another
            study is running (`study-running`).
    """

    def __init__(self, device: Path) -> None:
        self.path = device / FOLDER / FILE
        with storage_errors(self.path.parent):
            self.path.parent.mkdir(exist_ok=True)
        _check_header(self.path)
        self._stack, self._log = ExitStack(), None
        try:
            self._log = self._stack.enter_context(AppendLog(self.path, _HEADER, "log of studies"))
        except CaptureError:
            raise StudyError(
                "another study of this device is running",
                code="study-running",
                where=self.path,
                action="Wait for it, or stop it",
            ) from None
        self.records = read_records(self.path)

    def add(self, record: RunRecord) -> bool:
        """Add a record, unless its run has one already; broken runs are replaced.

        Returns:
            Whether it was added.

        Raises:
            StorageError: The file cannot be written.
        """
        before = self.records.get(record.run)
        if before is not None and (before.outcome != "broken" or record.outcome == "broken"):
            return False
        assert self._log is not None
        self._log.line(encode_record(record))
        self.records[record.run] = record
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, at)


def read_records(path: Path) -> dict[str, RunRecord]:
    """Read the records of a log by run; the last record of a run counts, cut lines are left out.

    Raises:
        StudyError: A line is not a record (`record-invalid`).
    """
    records = {}
    for number, line in LogLines(path):
        if number == 1:
            continue
        try:
            record = decode_record(line)
        except msgspec.DecodeError as error:
            raise StudyError(
                f"is not a record of a run ({error})",
                code="record-invalid",
                where=f"{path}:{number}",
                action="Remove that line to repeat its run",
                line=number,
            ) from None
        records[record.run] = record
    return records


def _check_header(path: Path) -> None:
    """Raise StudyError for the file of another program or version, which is not changed."""
    with storage_errors(path):
        if not path.exists():
            return
        with path.open("rb") as file:
            start = file.read(len(_HEADER) + 1)
    expected = f"{_HEADER}\n".encode()
    if not expected.startswith(start):
        raise StudyError(
            "is not a log of studies of this version",
            code="not-a-study-log",
            where=path,
            action="Move it away to start the study again",
        )
