"""Make a dataset of tables of signals and tables of targets, of any sensor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...capture.clocks.synchronization import synchronize_by_motion
from ...core.arrays import Float
from ...core.errors import CaptureError, TrainingError
from ...decoding.quantities import COUNTS, RELATIVE, Readings, Targets
from ..data.dataset import Dataset, Recording
from .column_units import LENGTH, Column, find_time, is_clock, parse_column
from .pair_dataset import RecordingInfo, require_common_time
from .series import OTHER_COLUMNS, RUN, increasing_times, read_table

#: Name of the sensor of tables that belong to no device.
SENSOR = "sensor"

_MIN_INCREASING_SHARE = 0.99  # of the rows
_MAX_CHANGE = 10.0  # smaller numbers without a unit are (R - R0)/R0, larger ones are counts
_MIN_REFERENCE_RATIO = 0.2  # of a channel's range, for its reference to be its scale
_RANGE_PERCENTILES = (1.0, 99.0)


@dataclass(frozen=True)
class _Table:
    """A table with increasing times, in the units of its columns.

    Attributes:
        path: The file.
        columns: The columns (k,), without the times.
        time: Times (n,), s.
        values: Numbers (n, k); NaN where a cell is empty.
        notes: What was left out or assumed.
    """

    path: Path
    columns: tuple[Column, ...]
    time: Float
    values: Float
    notes: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)


def table_dataset(
    signals: Sequence[Path], targets: Sequence[Path], info: RecordingInfo | None = None
) -> Dataset:
    """Make a dataset of tables, one run for each pair.

    A table has a column of times and one column for each channel or target, whose unit is in its
    header: `angle_deg`, `angle [deg]`, `left_kohm`. Targets are positions if all columns are x, y
    and z of points, in a unit of length or none, otherwise scalars. Signals are relative to a
    reference, which is the median of the first half of the first run, except for (R - R0)/R0.

    Args:
        signals: Tables of signals, one for each run.
        targets: Tables of targets in the same order.
        info: Facts that the files do not state; its markers are not used.

    Returns:
        The dataset.

    Raises:
        TrainingError: If a file is not such a table, or the runs do not match each other.
    """
    info = info or RecordingInfo()
    names = name_runs(signals)
    tables = [(_read(a), _read(b)) for a, b in zip(signals, targets, strict=True)]
    first_signals, first_targets = tables[0]
    units, unit_notes = _reading_units(first_signals)
    kinds, order = _target_kinds(first_targets)
    readings: Readings | None = None
    runs, sessions = list[Recording](), list[dict[str, Any]]()
    device = info.device or info.fallback_device or SENSOR
    for name, (table, truth) in zip(names, tables, strict=True):
        table, truth = _match_columns(table, first_signals), _match_columns(truth, first_targets)
        points = truth.values[:, order].reshape(len(truth.time), -1, kinds.axes)
        points = np.where(np.isfinite(points).all(axis=2, keepdims=True), points, np.nan)
        time, error, offset = _synchronize(table, truth, points, info)
        require_common_time(str(table.path), time, str(truth.path), truth.time)
        if readings is None:
            readings = make_readings(units, table.values, f"the first half of {name}")
        runs.append(
            Recording(
                name=name,
                session=name,
                unit=info.unit or device,
                sample_time=time,
                ohm=table.values,
                rest=readings.reference,
                time=truth.time,
                points=points,
                sigma=np.full(points.shape, np.nan),
                sync_error=error,
                scale=readings.scale,
            )
        )
        notes = [*table.notes, *truth.notes, *(unit_notes if len(runs) == 1 else ())]
        files = {"signals": str(table.path), "targets": str(truth.path)}
        sessions.append(
            _describe_run(name, files, info, device) | {"offset": offset, "notes": notes}
        )
    assert readings is not None
    return Dataset(
        device,
        info.layout,
        first_signals.names,
        np.arange(len(kinds.names)),
        _reference_points(runs[0], len(kinds.names), kinds.axes),
        tuple(runs),
        {"sessions": sessions},
        targets=kinds,
        readings=readings,
    )


def _describe_run(
    name: str, files: dict[str, str], info: RecordingInfo, device: str
) -> dict[str, Any]:
    """Return the facts on a run for the provenance."""
    return {
        "folder": name,
        **files,
        "device": device,
        "unit": info.unit,
        "layout": info.layout,
        "offset_by": "motion" if info.offset == "auto" else "user",
    }


def name_runs(paths: Sequence[Path]) -> tuple[str, ...]:
    """Return a distinct name for each file: its stem, with its folder or a number if needed.

    Args:
        paths: The files.
    """
    names = [p.stem for p in paths]
    if len(set(names)) < len(names):
        names = [f"{p.resolve().parent.name}/{p.stem}" for p in paths]
    counts, used = Counter(names), Counter[str]()
    for k, name in enumerate(names):
        if counts[name] > 1:
            used[name] += 1
            names[k] = f"{name}-{used[name]}"
    return tuple(names)


def make_readings(units: tuple[str, ...], values: Float, source: str) -> Readings:
    """Choose the reference and the scale of channels.

    Args:
        units: Units of the channels (c,).
        values: Readings (n, c) of one run.
        source: The part of the data that the reference is the median of, for notes.

    Returns:
        The readings. A positive channel's scale is its reference, that of others their range.
    """
    c = len(units)
    reference, scale = np.zeros(c), np.ones(c)
    first = values[: max(len(values) // 2, 1)]
    for k, unit in enumerate(units):
        if unit == RELATIVE:
            continue
        known = first[np.isfinite(first[:, k]), k]
        known = known if len(known) else values[np.isfinite(values[:, k]), k]
        if not len(known):
            continue  # the channel is left out where data are prepared
        reference[k] = np.median(known)
        width = float(np.subtract(*np.percentile(known, _RANGE_PERCENTILES[::-1])))
        is_positive = known.min() > 0 and reference[k] > _MIN_REFERENCE_RATIO * width
        scale[k] = reference[k] if is_positive else width or 1.0
    is_relative = all(unit == RELATIVE for unit in units)
    return Readings(
        units, reference, scale, "R0, as given" if is_relative else f"median of {source}"
    )


def read_columns(path: Path) -> tuple[tuple[Column, ...], Float, Float]:
    """Read the signals of a table.

    Args:
        path: The file.

    Returns:
        Its columns (k,), times (n,), s, and values (n, k) in the columns' units.

    Raises:
        TrainingError: If the file is not such a table.
    """
    table = _read(path)
    return table.columns, table.time, table.values


def _read(path: Path) -> _Table:
    """Read a table; sort out its columns and keep rows whose times increase."""
    table = read_table(path)
    if len(set(table.run)) > 1:
        raise TrainingError(
            f"has rows of {len(set(table.run))} runs",
            code="several-runs",
            where=path,
            action="Give a file for each run",
            count=len(set(table.run)),
        )
    found = find_time(table.names)
    if found is None:
        raise TrainingError(
            f"has no column time; its columns are {', '.join(table.names)}",
            code="column-missing",
            where=path,
            action="Name the column of the times time, in s",
            column="time",
        )
    rest = [n for n in table.names if n not in (found[0], RUN, *OTHER_COLUMNS)]
    headers = [n for n in rest if not is_clock(n)]
    columns = tuple(parse_column(h) for h in headers)
    repeated = [n for n, count in Counter(c.name for c in columns).items() if count > 1]
    if repeated:
        raise TrainingError(
            f"the column {repeated[0]} appears twice, in different units",
            code="column-repeated",
            where=path,
            action="Delete one of them",
            column=repeated[0],
        )
    values = table.columns(headers) * [c.factor for c in columns]
    time = table[found[0]] * found[1]
    values = np.where(np.isfinite(values), values, np.nan)
    if not columns or not np.isfinite(values).any():
        raise TrainingError(
            "has no column with a number in it, besides the times",
            code="no-samples",
            where=path,
            action="Write a column for each channel or target",
        )
    is_kept = increasing_times(time)
    if is_kept.sum() < _MIN_INCREASING_SHARE * np.isfinite(time).sum():
        k = int(np.argmin(is_kept))
        raise TrainingError(
            f"{len(is_kept) - int(is_kept.sum())} of {len(is_kept)} rows are not later than those"
            f" before; the first is row {k + 1}, at {time[k]:.3f} s",
            code="times-not-increasing",
            where=path,
            action="If these are several runs, give a file for each",
            index=k,
        )
    if is_kept.sum() < 2:
        raise TrainingError(
            f"has {int(is_kept.sum())} rows with a time", code="no-samples", where=path
        )
    notes = list(table.notes)
    if clocks := [n for n in rest if is_clock(n)]:
        notes.append(
            f"{path.name}: {', '.join(clocks)} left out, as times or numbers of rows; the times are"
            f" {found[0]}"
        )
    if lost := int((~is_kept).sum()):
        notes.append(f"{path.name}: {lost} rows whose time does not increase are left out")
    return _Table(path, columns, time[is_kept], values[is_kept], tuple(notes))


def _reading_units(table: _Table) -> tuple[tuple[str, ...], list[str]]:
    """Return the units of the channels, and notes on those that the header does not state."""
    unknown = [k for k, column in enumerate(table.columns) if not column.unit]
    units = [column.unit for column in table.columns]
    notes = []
    if unknown:
        values = np.abs(table.values[:, unknown])
        values = values[np.isfinite(values)]
        is_large = len(values) > 0 and float(np.median(values)) > _MAX_CHANGE
        unit = COUNTS if is_large else RELATIVE
        for k in unknown:
            units[k] = unit
        names = ", ".join(table.columns[k].name for k in unknown[:3])
        names += f" and {len(unknown) - 3} more" if len(unknown) > 3 else ""
        if is_large:
            notes.append(
                f"{names} are taken as counts, no unit given; give a unit in the header if there is"
                f" one, such as {table.columns[unknown[0]].name}_ohm"
            )
        else:
            notes.append(f"{names} are taken as (R - R0)/R0, no unit given")
    return tuple(units), notes


def _target_kinds(table: _Table) -> tuple[Targets, list[int]]:
    """Return the targets of a table, and the order of its columns.

    Targets are points if all columns are their axes, otherwise scalars.
    """
    if (triples := _find_triples(table.columns)) is not None:
        units = tuple(table.columns[index[0]].unit for index in triples.values())
        return Targets(tuple(triples), units, 3), [k for index in triples.values() for k in index]
    units = tuple(c.unit for c in table.columns)
    return Targets(table.names, units, 1), list(range(len(units)))


def _find_triples(columns: Sequence[Column]) -> dict[str, list[int]] | None:
    """Return the indices of each point's x, y and z; None unless all columns are such axes."""
    points: dict[str, dict[int, int]] = {}
    for k, column in enumerate(columns):
        if column.axis is None:
            return None
        points.setdefault(column.axis[0], {})[column.axis[1]] = k
    triples = {name: [axes[i] for i in sorted(axes)] for name, axes in points.items()}
    is_complete = all(
        len(index) == 3
        and len({columns[k].unit for k in index}) == 1
        and (columns[index[0]].kind == LENGTH or not columns[index[0]].unit)
        for index in triples.values()
    )
    return triples if is_complete and len(columns) == 3 * len(triples) else None


def _match_columns(table: _Table, first: _Table) -> _Table:
    """Return a table with the columns of the first run, in their order and unit."""
    missing = [n for n in first.names if n not in table.names]
    extra = [n for n in table.names if n not in first.names]
    if missing or extra:
        wrong = f"has no column {missing[0]}" if missing else f"has an extra column {extra[0]}"
        raise TrainingError(
            f"{wrong}: its columns are {', '.join(table.names)}, but {first.path.name} has"
            f" {', '.join(first.names)}",
            code="columns-differ",
            where=table.path,
            action="Name the columns alike in all runs",
            missing=tuple(missing),
            extra=tuple(extra),
        )
    order = [table.names.index(n) for n in first.names]
    for k, column in zip(order, first.columns, strict=True):
        if table.columns[k].unit != column.unit:
            mine, other = (u or "no unit" for u in (table.columns[k].unit, column.unit))
            raise TrainingError(
                f"{column.name} has {mine}, but {other} in {first.path.name}",
                code="units-differ",
                where=table.path,
                action="Give all runs in the same units",
                column=column.name,
                units=(table.columns[k].unit, column.unit),
            )
    columns = tuple(table.columns[k] for k in order)
    return replace(table, columns=columns, values=table.values[:, order])


def _synchronize(
    table: _Table, truth: _Table, points: Float, info: RecordingInfo
) -> tuple[Float, float | None, str]:
    """Return sample times (n,) s on the targets' clock, their standard error, and a description."""
    if info.offset != "auto":
        return table.time + float(info.offset), None, f"{float(info.offset):g} s, as given"
    flat = points.reshape(len(points), -1)
    flat = flat[:, np.isfinite(flat).mean(axis=0) > 0.5]
    try:
        sync = synchronize_by_motion(truth.time, flat, table.time, table.values)
    except CaptureError as error:
        raise TrainingError(
            f"no offset between {table.path} and {truth.path} is found ({error})",
            code="offset-not-found",
            action="Give the offset",
        ) from None
    description = f"{sync.offset:.4f} s and a drift of {sync.drift:.2e}, by motion"
    return sync.to_camera(table.time), sync.error, description


def _reference_points(r: Recording, m: int, axes: int) -> Float:
    """Return the median targets (m, r) of the first half of a run; 0 for targets without values."""
    out = np.zeros((m, axes))
    for part in (r.points, r.points[: max(len(r.time) // 2, 1)]):
        for k in range(m):
            known: Float = part[np.isfinite(part[:, k, 0]), k]
            if len(known):
                out[k] = np.median(known, axis=0)
    return out
