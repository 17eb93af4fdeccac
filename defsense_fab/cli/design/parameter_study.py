"""Run the parameter study of a `study.toml`, and print its results."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ..device import parse_overrides
from ..options import check_range
from ..output import console, print_json, print_lines, progress_bars, silent_stdout, standard_output

if TYPE_CHECKING:
    from ...workflow.study.parameter_study import StudyResult
    from ...workflow.study.runs.run_log import RunRecord

_MAX_SHOWN_RUNS = 10
_MAX_SHOWN_MEASURES = 5
_MAX_WORKERS = 512


def run_parameter_study(options: argparse.Namespace) -> int:
    """Run the study of the device folder, and print the results.

    Raises:
        DefsenseError: The study or an option is invalid, or the study cannot be run.
    """
    from ...mechanics.elements.threads import count_cores
    from ...workflow.study.parameter_study import run_study

    workers = options.workers if options.workers is not None else count_cores()
    check_range("--workers", workers, 1, _MAX_WORKERS)
    fixed = {f"body.parameters.{k}": v for k, v in parse_overrides(options.set).items()}
    with silent_stdout(), progress_bars(options) as progress:
        result = run_study(options.folder, fixed, workers, options.scheduler, progress)
    with standard_output():
        if options.json:
            print_json(_to_json(result))
        else:
            _print_results(result, options)
    return 0


def _to_json(result: StudyResult) -> dict[str, Any]:
    import msgspec

    table = result.table
    return {
        "runs": table.runs,
        "points": table.points,
        "made": result.made,
        "done": [msgspec.to_builtins(r) for r in table.done],
        "failed": [msgspec.to_builtins(r) for r in table.failed],
        "front": [r.run for r in result.front],
        "sensitivities": [msgspec.to_builtins(s) for s in result.sensitivities],
        "sobol": msgspec.to_builtins(result.sobol),
        "file": str(result.file),
        "page": str(result.page),
        "best": None if result.best is None else str(result.best),
    }


def _print_results(result: StudyResult, options: argparse.Namespace) -> None:
    from ...workflow.study.results.study_page import group_failures

    table = result.table
    summary = f"{len(table.done)} runs of {table.points} points, {result.made} of them new"
    print_lines([f"{summary}; {len(table.failed)} failed" if table.failed else summary])
    console().print(_best_runs_table(result))
    if result.sensitivities:
        print_lines(["effect of each parameter (Spearman's coefficient, share of variance):"])
        print_lines(
            f"  {s.key}: {'choice' if s.rho is None else f'{s.rho:+.2f}'},"
            f" {'unknown' if s.share is None else f'{s.share:.2f}'}"
            for s in result.sensitivities
        )
    for message, rows in group_failures(table.failed):
        print_lines([f"failed: {len(rows)} {'run' if len(rows) == 1 else 'runs'}: {message}"])
    print_lines([f"Look at: {result.page}", f"Numbers: {result.file}"])
    if result.best is not None:
        print_lines([
            f"Next:    cp {result.best} {options.folder / 'device.toml'}, to use the best run, then"
            f" defsense build {options.folder}"
        ])  # fmt: skip


def _best_runs_table(result: StudyResult) -> Any:
    from rich.table import Table

    from ...workflow.study.results.study_page import format_value

    study, rows = result.table.study, result.table.done[:_MAX_SHOWN_RUNS]
    title = f"Runs with the smallest {study.minimise}" if study.minimise else "Runs"
    first = [m for m in ("error", "cords", "parts", "decoder") if m in study.record]
    measures = list(dict.fromkeys([study.minimise or study.record[0], *first, *study.record]))
    measures = measures[:_MAX_SHOWN_MEASURES]
    table = Table(title=title)
    keys = [p.key for p in study.parameters]
    for name in (*keys, *measures):
        table.add_column(name, justify="right")
    for run in rows:
        table.add_row(*_cells(run, keys, measures, format_value))
    return table


def _cells(record: RunRecord, keys: list[str], measures: list[str], format_value: Any) -> list[str]:
    values = [record.parameters.get(k) for k in keys] + [record.measures.get(m) for m in measures]
    return [format_value(v) for v in values]
