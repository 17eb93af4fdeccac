"""Compare training with other regressors on recordings of real sensors.

    python -m benchmarks.real --data FOLDER
    python -m benchmarks.real --data FOLDER --only ankle --out pictures --json results.json
    python -m benchmarks.real --data FOLDER --shifts

FOLDER has a sub-folder for each recording: `signals.csv` and `targets.csv`, or `run0-signals.csv`,
`run0-targets.csv`, ...; and `README.md`. The project contains no recordings; without any, nothing
is measured. `docs/contributing/benchmark-real.md` describes the data, the split, the rule of
choosing and the tables. Errors are root mean squares on the last 30 % in time of all runs, or on
runs left out.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from benchmarks.peers.regression import recur, regress
from benchmarks.real.ours import Curves, mean_error, measure_ours
from benchmarks.real.recordings import Source, Task, find_sources, thirds_of_runs
from benchmarks.real.report import (
    Row,
    channel_table,
    draw,
    error_table,
    interval_table,
    published_text,
    shift_table,
    summary,
    time_table,
)
from benchmarks.real.shifts import ShiftResult, measure_shifts
from defsense_fab.core.errors import DefsenseError


def measure(source: Source, task: Task, name: str, seed: int) -> tuple[Row, Curves]:
    """Measure all decoders on one split of a recording."""
    units = tuple(dict.fromkeys(task.dataset.units))
    ours, curves = measure_ours(task)
    row = Row(
        name,
        units[0] if len(units) == 1 else "of spread",
        task.train.duration_s + task.test.duration_s,
        (len(task.train), len(task.test)),
        mean_error(task),
        ours,
        [*regress(task, seed), *recur(task, seed)],
        source.published,
    )
    return row, curves


def measure_recording(source: Source, seed: int, out: Path | None) -> tuple[Row, list[Row]]:
    """Measure a recording split by time and, with three or more runs, by runs."""
    dataset = source.read()
    task = Task.divide(dataset)
    row, curves = measure(source, task, source.name, seed)
    if out is not None:
        draw(row, task, curves, out / f"{source.name}.png")
    runs = []
    for k, names in enumerate(thirds_of_runs(dataset)):
        part = Task.divide(dataset, names)
        numbers = ", ".join(str(i) for i in range(k, len(dataset.recordings), 3))
        row_of_runs, _ = measure(source, part, f"{source.name} without runs {numbers}", seed)
        runs.append(row_of_runs)
    return row, runs


def print_tables(rows: list[Row]) -> None:
    """Print all tables of rows."""
    for table in (error_table, published_text, interval_table, channel_table, time_table, summary):
        print(f"\n{table(rows)}", flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmark.

    Args:
        arguments: Arguments of the command; those of the process by default.

    Returns:
        The exit code: 0, also without recordings; 1 if a recording cannot be read or trained on.
    """
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder with a sub-folder for each recording")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="recordings to use")
    parser.add_argument("--out", type=Path, help="folder for a picture of each recording")
    parser.add_argument("--json", type=Path, help="file for all results")
    parser.add_argument("--shifts", action="store_true", help="measure shifts of clocks instead")
    parser.add_argument("--seed", type=int, default=0, help="seed of trees and networks")
    options = parser.parse_args(arguments)
    sources = find_sources(options.data, options.only)
    if not sources:
        where = "no folder is given (--data)" if options.data is None else str(options.data)
        print(f"Skipped: no recordings found; {where}. The project contains none.")
        return 0
    start = time.process_time()
    rows, runs, failed = list[Row](), list[Row](), list[str]()
    warnings, shifts = dict[str, list[str]](), dict[str, list[ShiftResult]]()

    def save() -> None:
        """Write what is measured so far."""
        if options.json is None:
            return
        results = {
            "seed": options.seed,
            "cpu_s": time.process_time() - start,
            "recordings": [r.to_json() for r in rows],
            "runs_left_out": [r.to_json() for r in runs],
            "clock_warnings": warnings,
            "shifts": {n: [vars(r) for r in each] for n, each in shifts.items()},
            "failed": failed,
        }
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(json.dumps(results, indent=1, default=_plain), encoding="utf-8")

    for source in sources:
        try:
            if options.shifts:
                warnings[source.name], shifts[source.name] = measure_shifts(source.read())
            else:
                row, rows_of_runs = measure_recording(source, options.seed, options.out)
                rows.append(row)
                runs += rows_of_runs
        except DefsenseError as error:
            failed.append(f"{source.name}: {error}")
            continue
        save()
        print(f"{source.name}: done, {time.process_time() - start:.0f} CPU s in all", flush=True)
    if shifts:
        print(f"\n{shift_table(shifts)}")
        for name, each in warnings.items():
            print("\n".join([f"\n{name}: {len(each)} warnings on its clocks", *each]))
    for part in (rows, runs):
        if part:
            print_tables(part)
    for message in failed:
        print(f"Failed: {message}")
    save()
    return 1 if failed else 0


def _plain(value: object) -> object:
    """Return NumPy numbers as plain ones."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(type(value).__name__)


if __name__ == "__main__":
    raise SystemExit(main())
