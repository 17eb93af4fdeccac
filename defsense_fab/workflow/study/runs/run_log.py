"""`study/runs.log`: what came of every run of a device's studies, a line each, only added to."""

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
_HEAD = '{"log": "runs of defsense studies", "schema": 1}'

#: `done`; `refused` by the design itself, as it would be again; `broken` by what is not the
#: design's: memory, time, a worker that died, a fault of the program.
Outcome = Literal["done", "refused", "broken"]


@dataclass(frozen=True)
class Cost:
    """Of one run: seconds, CPU seconds of all its processes and those of them that went into what
    the runs of its batch share (body, mesh and poses), peak memory of the process until then (MB),
    bytes sent for it and sent back."""

    seconds: float = 0.0
    cpu: float = 0.0
    shared_cpu: float = 0.0
    memory: float = 0.0
    sent: int = 0
    returned: int = 0


@dataclass(frozen=True)
class RunRecord:
    """A run by the hash of all that it depends on, its parameters, what came of it, and in what
    words; what was measured, what it cost, and where it was made."""

    run: str
    parameters: Mapping[str, Any]
    outcome: Outcome
    message: str = ""
    measures: Mapping[str, Value] = field(default_factory=dict)
    cost: Cost = Cost()
    worker: str = ""

    def told_bytes(self, sent: int) -> RunRecord:
        """With the bytes sent for it, and those of itself."""
        return replace(self, cost=replace(self.cost, sent=sent, returned=len(encoded(self))))


def encoded(record: RunRecord) -> str:
    """As a line."""
    return msgspec.json.encode(record).decode()


def decoded(line: str) -> RunRecord:
    """Raises msgspec.DecodeError for what is no record."""
    return msgspec.json.decode(line, type=RunRecord)


class RunLog:
    """The log of a device's studies while one runs: `found` are the records by run; nothing is
    added twice. Used in `with`."""

    def __init__(self, device: Path) -> None:
        """Raises StudyError for a file that is not such a log, or that another study writes to."""
        self.path = device / FOLDER / FILE
        with storage_errors(self.path.parent):
            self.path.parent.mkdir(exist_ok=True)
        _refuse_others(self.path)
        self._stack, self._log = ExitStack(), None
        try:
            self._log = self._stack.enter_context(AppendLog(self.path, _HEAD, "log of studies"))
        except CaptureError:
            raise StudyError(
                f"{self.path}: another study of this device is running; wait for it, or stop it"
            ) from None
        self.found = read_records(self.path)

    def add(self, record: RunRecord) -> bool:
        """Whether it was new: of a run that is there already, only one that was broken is replaced.
        Raises StorageError."""
        before = self.found.get(record.run)
        if before is not None and (before.outcome != "broken" or record.outcome == "broken"):
            return False
        assert self._log is not None
        self._log.line(encoded(record))
        self.found[record.run] = record
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
    """The records of a log by run, of those of one run the last; lines that were cut are left out.
    Raises StudyError for a line that is no record."""
    found = {}
    for number, line in LogLines(path):
        if number == 1:
            continue
        try:
            record = decoded(line)
        except msgspec.DecodeError as error:
            raise StudyError(
                f"{path}:{number}: is no record of a run ({error}); remove that line, and its run"
                " is made again"
            ) from None
        found[record.run] = record
    return found


def _refuse_others(path: Path) -> None:
    """A file of that name that is another program's, or another version's, is left as it is."""
    with storage_errors(path):
        if not path.exists():
            return
        with path.open("rb") as file:
            begins = file.read(len(_HEAD) + 1)
    wanted = f"{_HEAD}\n".encode()
    if not wanted.startswith(begins):
        raise StudyError(
            f"{path}: is not the log of this version's studies; move it away, and the study begins"
            " anew"
        )
