"""The table of a study's runs, its Pareto front, and its file: Parquet, or CSV without pyarrow."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Bool, Float
from ....core.errors import StudyError
from ....core.schema.types import is_number
from ....core.storage.files import replace_file, storage_errors
from ..points.study_toml import Study
from ..runs.run_log import FOLDER, RunRecord

#: Measures of the Pareto front, all to be small, if they are recorded.
ASPECTS = ("error", "parts", "cords")


def find_pareto_front(values: Float) -> Bool:
    """Return which rows (n,) are on the Pareto front.

    Args:
        values: Values (n, k), all to be small.

    Returns:
        Whether no other row is smaller in one value and at most equal in the others. Equal rows are
        on the front together.
    """
    is_on_front = np.ones(len(values), bool)
    for i, row in enumerate(values):
        is_on_front[i] = not ((values <= row).all(1) & (values < row).any(1)).any()
    return is_on_front


def find_compromises(table: StudyTable) -> list[RunRecord]:
    """Return the runs on the Pareto front of the recorded aspects, sorted as `table.done`.

    There are none if fewer than two aspects are recorded.
    """
    names = recorded_aspects(table)
    rows = [r for r in table.done if all(is_number(r.measures.get(n)) for n in names)]
    if len(names) < 2 or not rows:
        return []
    values = np.array([[r.measures[n] for n in names] for r in rows], dtype=float)
    return [r for r, is_on in zip(rows, find_pareto_front(values), strict=True) if is_on]


def recorded_aspects(table: StudyTable) -> list[str]:
    """Return the aspects that a study records."""
    return [name for name in ASPECTS if name in table.study.record]


PARQUET, TABLE = "results.parquet", "results.csv"
_METADATA_KEY = b"defsense-fab study"
_COST_COLUMNS = ("seconds", "cpu", "shared_cpu", "memory", "sent", "returned")


@dataclass(frozen=True)
class StudyTable:
    """The finished runs of a study.

    Attributes:
        device: Name of the device.
        study: The study.
        rows: The finished runs, in the order of their points.
        runs: Number of all runs.
        points: Number of all points.
        versions: Versions of the software that made them, by name.
    """

    device: str
    study: Study
    rows: tuple[RunRecord, ...]
    runs: int
    points: int
    versions: Mapping[str, str]

    @property
    def done(self) -> list[RunRecord]:
        """The successful runs; the best first, if a measure is minimized."""
        rows = [r for r in self.rows if r.outcome == "done"]
        name = self.study.minimise
        return sorted(rows, key=lambda r: _sort_value(r.measures.get(name))) if name else rows

    @property
    def failed(self) -> list[RunRecord]:
        """The runs that did not succeed."""
        return [r for r in self.rows if r.outcome != "done"]

    @property
    def keys(self) -> list[str]:
        """Keys of all parameters, with those that are fixed."""
        return list(dict.fromkeys(key for row in self.rows for key in row.parameters))


def _sort_value(value: Any) -> float:
    return float(value) if is_number(value) else float("inf")


def check_table_owner(device: Path, name: str) -> None:
    """Check that results would not replace those of another device.

    Args:
        device: Folder of the device.
        name: Name of the device.

    Raises:
        StudyError: A file of the results belongs to something else (`results-of-another-device`,
            `not-a-study-table`), or cannot be read (`library-missing`).
    """
    path = device / FOLDER / PARQUET
    library = _pyarrow()
    if path.exists():
        if library is None:
            raise StudyError(
                "cannot be read without pyarrow, and would be replaced",
                code="library-missing",
                where=path,
                action="Type: pip install defsense-fab[exchange], or move the file away",
                package="pyarrow",
            )
        metadata = _read_metadata(library, path)
        if metadata is None:
            raise _not_a_table(path)
        if metadata.get("device") != name:
            raise _other_device(path, metadata.get("device"))
    path = device / FOLDER / TABLE
    if path.exists():
        with storage_errors(path), path.open(encoding="utf-8", errors="replace") as file:
            rows = csv.reader(file)
            try:
                head, first = next(rows, []), next(rows, [])
            except csv.Error:  # a line is longer than those of a table
                head, first = [], []
        if head[:3] != ["device", "run", "outcome"]:
            raise _not_a_table(path)
        if first and first[0] != name:
            raise _other_device(path, first[0])


def _not_a_table(path: Path) -> StudyError:
    return StudyError(
        "is not a table of a study",
        code="not-a-study-table",
        where=path,
        action="Move it away, and run the study again",
    )


def _other_device(path: Path, device: Any) -> StudyError:
    return StudyError(
        f"contains results of the device {device!r}",
        code="results-of-another-device",
        where=path,
        action="Move it away, and run the study again",
        device=device,
    )


def write_table(device: Path, table: StudyTable) -> Path:
    """Write the table, and remove a table of the other format.

    Args:
        device: Folder of the device.
        table: The table.

    Returns:
        The file.

    Raises:
        StorageError: The file cannot be written.
    """
    rows = [_row(table, r) for r in table.rows]
    library = _pyarrow()
    path = device / FOLDER / (PARQUET if library else TABLE)
    if library is None:
        with (
            replace_file(path) as temporary,
            temporary.open("w", encoding="utf-8", newline="") as out,
        ):
            writer = csv.DictWriter(out, list(_row(table, None)))
            writer.writeheader()
            writer.writerows(rows)
        _remove(device / FOLDER / PARQUET)
        return path
    columns = {name: _uniform_column([r[name] for r in rows]) for name in _row(table, None)}
    arrow_table = library.table(columns).replace_schema_metadata(
        {_METADATA_KEY: json.dumps(_metadata(table))}
    )
    with replace_file(path) as temporary:
        library.parquet.write_table(arrow_table, temporary)
    _remove(device / FOLDER / TABLE)
    return path


def _remove(path: Path) -> None:
    with storage_errors(path):
        path.unlink(missing_ok=True)


def _row(table: StudyTable, record: RunRecord | None) -> dict[str, Any]:
    """Return the values of a run by column; None without a record."""
    row: dict[str, Any] = {"device": table.device}
    row |= {name: getattr(record, name, None) for name in ("run", "outcome", "message")}
    row |= {key: record.parameters.get(key) if record else None for key in table.keys}
    row |= {key: record.measures.get(key) if record else None for key in table.study.record}
    cost = asdict(record.cost) if record else {}
    return (
        row | {k: cost.get(k) for k in _COST_COLUMNS} | {"worker": getattr(record, "worker", None)}
    )


def _uniform_column(values: list[Any]) -> list[Any]:
    """Return the values of a column in one type: numbers, booleans, or texts."""
    present = [v for v in values if v is not None]
    if all(is_number(v) for v in present):
        is_whole = all(isinstance(v, int) and abs(v) < 2**63 for v in present)
        return [v if v is None or is_whole else float(v) for v in values]
    if all(isinstance(v, bool) for v in present):
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


def _read_metadata(library: Any, path: Path) -> dict[str, Any] | None:
    """Return the metadata of a study's file; None for another file."""
    try:
        metadata = library.parquet.read_schema(path).metadata or {}
        study = json.loads(metadata[_METADATA_KEY])
    except (OSError, ValueError, KeyError, library.ArrowException):
        return None
    return study if isinstance(study, dict) else None


def _pyarrow() -> Any:
    """Return the library; None if it is not installed."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return None
    return pyarrow
