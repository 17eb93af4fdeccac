"""What came of a study, run by run, and its file: Parquet, or CSV where pyarrow is missing."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ....core.errors import StudyError
from ....core.schema.types import is_number
from ....core.storage.files import replace_file, storage_errors
from ..points.study_toml import Study
from ..runs.run_log import FOLDER, RunRecord

PARQUET, TABLE = "results.parquet", "results.csv"
_KEY = b"defsense-fab study"
_COSTS = ("seconds", "cpu", "shared_cpu", "memory", "sent", "returned")


@dataclass(frozen=True)
class StudyTable:
    """The runs that are over, in the order of their points, of a study of `device`; how many
    `runs` and points it has in all, and the `versions` of the software that made them."""

    device: str
    study: Study
    rows: tuple[RunRecord, ...]
    runs: int
    points: int
    versions: Mapping[str, str]

    @property
    def done(self) -> list[RunRecord]:
        """The best first, where there is a measure that is to be small."""
        rows = [r for r in self.rows if r.outcome == "done"]
        name = self.study.minimise
        return sorted(rows, key=lambda r: _size(r.measures.get(name))) if name else rows

    @property
    def failed(self) -> list[RunRecord]:
        return [r for r in self.rows if r.outcome != "done"]

    @property
    def keys(self) -> list[str]:
        """Of all parameters, those that are fixed too."""
        return list(dict.fromkeys(key for row in self.rows for key in row.parameters))


def _size(value: Any) -> float:
    return float(value) if is_number(value) else float("inf")


def refuse_others(device: Path, name: str) -> None:
    """Raise StudyError where the place of the results holds what is not this device's."""
    path = device / FOLDER / PARQUET
    library = _pyarrow()
    if path.exists():
        if library is None:
            raise StudyError(
                f"{path}: cannot be read without pyarrow (pip install defsense-fab[exchange]), and"
                " would be replaced; install it, or move the file away"
            )
        told = _told(library, path)
        if told is None or told.get("device") != name:
            whose = f"the device {told.get('device')!r}" if told else "something else"
            raise StudyError(f"{path}: holds results of {whose}; move it away, and run it again")
    path = device / FOLDER / TABLE
    if path.exists():
        with storage_errors(path), path.open(encoding="utf-8", errors="replace") as file:
            found = csv.reader(file)
            try:
                head, first = next(found, []), next(found, [])
            except csv.Error:  # longer than any table's
                head, first = [], []
        if head[:3] != ["device", "run", "outcome"]:
            raise StudyError(f"{path}: is no table of a study; move it away, and run it again")
        if first and first[0] != name:
            raise StudyError(
                f"{path}: holds results of the device {first[0]!r}; move it away, and run it again"
            )


def write_table(device: Path, table: StudyTable) -> Path:
    """The file that was written, whole or not at all, in place of one before, of either format.
    Raises StorageError."""
    rows = [_row(table, r) for r in table.rows]
    library = _pyarrow()
    path = device / FOLDER / (PARQUET if library else TABLE)
    if library is None:
        with replace_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as out:
            writer = csv.DictWriter(out, list(_row(table, None)))
            writer.writeheader()
            writer.writerows(rows)
        _remove(device / FOLDER / PARQUET)
        return path
    columns = {name: _alike([r[name] for r in rows]) for name in _row(table, None)}
    made = library.table(columns).replace_schema_metadata({_KEY: json.dumps(_metadata(table))})
    with replace_file(path) as temporary:
        library.parquet.write_table(made, temporary)
    _remove(device / FOLDER / TABLE)
    return path


def _remove(path: Path) -> None:
    with storage_errors(path):
        path.unlink(missing_ok=True)


def _row(table: StudyTable, record: RunRecord | None) -> dict[str, Any]:
    """By the name of the column; empty without a record."""
    out: dict[str, Any] = {"device": table.device}
    out |= {name: getattr(record, name, None) for name in ("run", "outcome", "message")}
    out |= {key: record.parameters.get(key) if record else None for key in table.keys}
    out |= {key: record.measures.get(key) if record else None for key in table.study.record}
    cost = asdict(record.cost) if record else {}
    return out | {k: cost.get(k) for k in _COSTS} | {"worker": getattr(record, "worker", None)}


def _alike(values: list[Any]) -> list[Any]:
    """Of one type, as a column asks for: numbers, switches, or texts."""
    there = [v for v in values if v is not None]
    if all(is_number(v) for v in there):
        whole = all(isinstance(v, int) and abs(v) < 2**63 for v in there)
        return [v if v is None or whole else float(v) for v in values]
    if all(isinstance(v, bool) for v in there):
        return values
    return [v if v is None or isinstance(v, str) else json.dumps(v) for v in values]


def _metadata(table: StudyTable) -> dict[str, Any]:
    s = table.study
    return {
        "device": table.device,
        "design": s.design,
        "count": s.count,
        "seed": s.seed,
        "until": s.until,
        "runs": table.runs,
        "points": table.points,
        "versions": dict(table.versions),
        "parameters": [asdict(p) for p in s.parameters],
    }


def _told(library: Any, path: Path) -> dict[str, Any] | None:
    """The metadata of a study's file; None for another file."""
    try:
        metadata = library.parquet.read_schema(path).metadata or {}
        told = json.loads(metadata[_KEY])
    except (OSError, ValueError, KeyError, library.ArrowException):
        return None
    return told if isinstance(told, dict) else None


def _pyarrow() -> Any:
    """The library, or None where it is not installed."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return None
    return pyarrow
