"""`defsense study` with a `study.toml`: its runs, and what is shown of them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ..device import parse_overrides
from ..options import check_range
from ..output import console, print_json, print_lines, progress_bars, silent_stdout, standard_output

if TYPE_CHECKING:
    from ...workflow.study.parameter_study import StudyResult
    from ...workflow.study.runs.run_log import RunRecord

_SHOWN = 10  # best runs
_MEASURES = 5
_MOST_WORKERS = 512


def run_parameter_study(options: argparse.Namespace) -> int:
    """Make the study of the folder, and show it. Raises a DefsenseError."""
    from ...mechanics.elements.threads import count_cores
    from ...workflow.study.parameter_study import run_study

    workers = options.workers if options.workers is not None else count_cores()
    check_range("--workers", workers, 1, _MOST_WORKERS)
    fixed = {f"body.parameters.{k}": v for k, v in parse_overrides(options.set).items()}
    with silent_stdout(), progress_bars(options) as progress:
        found = run_study(options.folder, fixed, workers, options.scheduler, progress)
    with standard_output():
        if options.json:
            print_json(_as_json(found))
        else:
            _show(found, options)
    return 0


def _as_json(found: StudyResult) -> dict[str, Any]:
    import msgspec

    table = found.table
    return {
        "runs": table.runs,
        "points": table.points,
        "made": found.made,
        "done": [msgspec.to_builtins(r) for r in table.done],
        "failed": [msgspec.to_builtins(r) for r in table.failed],
        "front": [r.run for r in found.front],
        "sensitivities": [msgspec.to_builtins(s) for s in found.sensitivities],
        "sobol": msgspec.to_builtins(found.sobol),
        "file": str(found.file),
        "page": str(found.page),
        "best": None if found.best is None else str(found.best),
    }


def _show(found: StudyResult, options: argparse.Namespace) -> None:
    from ...workflow.study.results.study_page import group_failures

    table = found.table
    told = f"{len(table.done)} runs of {table.points} points, {found.made} of them made now"
    print_lines([f"{told}; {len(table.failed)} failed" if table.failed else told])
    console().print(_best(found))
    if found.sensitivities:
        print_lines(
            ["which parameters matter (Spearman's coefficient, share of the ranks' variance):"]
        )
        print_lines(
            f"  {s.key}: {'choice' if s.rho is None else f'{s.rho:+.2f}'},"
            f" {'unknown' if s.share is None else f'{s.share:.2f}'}"
            for s in found.sensitivities
        )
    for message, rows in group_failures(table.failed):
        print_lines([f"failed, {len(rows)} {'run' if len(rows) == 1 else 'runs'}: {message}"])
    print_lines([f"Look at: {found.page}", f"Numbers: {found.file}"])
    if found.best is not None:
        print_lines([
            f"Next:    cp {found.best} {options.folder / 'device.toml'}, for the best run's values,"
            f" then defsense build {options.folder}"
        ])  # fmt: skip


def _best(found: StudyResult) -> Any:
    from rich.table import Table

    from ...workflow.study.results.study_page import format_value

    study, rows = found.table.study, found.table.done[:_SHOWN]
    title = f"runs with the least {study.minimise}" if study.minimise else "runs"
    first = [m for m in ("error", "cords", "parts", "decoder") if m in study.record]
    measures = list(dict.fromkeys([study.minimise or study.record[0], *first, *study.record]))
    measures = measures[:_MEASURES]
    out = Table(title=title)
    keys = [p.key for p in study.parameters]
    for name in (*keys, *measures):
        out.add_column(name, justify="right")
    for r in rows:
        out.add_row(*_cells(r, keys, measures, format_value))
    return out


def _cells(record: RunRecord, keys: list[str], measures: list[str], format_value: Any) -> list[str]:
    values = [record.parameters.get(k) for k in keys] + [record.measures.get(m) for m in measures]
    return [format_value(v) for v in values]
