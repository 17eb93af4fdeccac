"""The log of a device's runs: one line of JSON per run; lines are only appended."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec

from ...core.storage.append_log import AppendLog, LogLines
from ...core.storage.files import storage_errors
from .measures import Value

FOLDER, FILE = "study", "runs.log"
_HEADER = '{"log": "runs of defsense studies", "schema": 1}'

#: `done`; `refused` by the design itself, as it would be again; `broken` by other causes: memory,
#: time, a worker that died, a fault of the program.
Outcome = Literal["done", "refused", "broken"]


@dataclass(frozen=True)
class RunRecord:
    """The result of a run.

    Attributes:
        run: Hash of all inputs of the run.
        parameters: Values by dotted key of `device.toml`.
        outcome: Whether it succeeded.
        message: Why it did not succeed.
        measures: Measured values by name.
        seconds: Duration, s.
        cpu: CPU time of all its processes, s.
        memory: Peak memory of its process, MB.
        worker: Name of the machine.
    """

    run: str
    parameters: Mapping[str, Any]
    outcome: Outcome
    message: str = ""
    measures: Mapping[str, Value] = field(default_factory=dict)
    seconds: float = 0.0
    cpu: float = 0.0
    memory: float = 0.0
    worker: str = ""


def encode_record(record: RunRecord) -> str:
    """Return a record as a line."""
    return msgspec.json.encode(record).decode()


def read_records(path: Path) -> list[RunRecord]:
    """Return the records of a log or a part of it; lines that are cut or damaged are omitted."""
    records = []
    for _, line in LogLines(path):
        with suppress(msgspec.DecodeError):
            records.append(msgspec.json.decode(line, type=RunRecord))
    return records


class RunLog:
    """The log of a device's studies while one runs; a context manager.

    Args:
        device: Folder of the device.

    Attributes:
        records: The last record of each run; damaged lines are omitted.

    Raises:
        CaptureError: The file is not such a log, or another study of the device is running.
        StorageError: The file cannot be written.
    """

    def __init__(self, device: Path) -> None:
        path = device / FOLDER / FILE
        with storage_errors(path.parent):
            path.parent.mkdir(exist_ok=True)
        self._log = AppendLog(path, _HEADER, "log of studies")
        self.records = {record.run: record for record in read_records(path)}

    def is_missing(self, run: str) -> bool:
        """Return whether a run has no result, or one that another attempt may improve."""
        return run not in self.records or self.records[run].outcome == "broken"

    def add(self, record: RunRecord) -> None:
        """Append a record.

        Raises:
            StorageError: The file cannot be written.
        """
        self._log.line(encode_record(record))
        self.records[record.run] = record

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *_: object) -> None:
        self._log.close()
