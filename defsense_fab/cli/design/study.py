"""The command `defsense study`: vary the number of cords, or the parameters of study.toml."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ...core.errors import DeviceError
from ...workflow.study.options import StudyOptions
from ..app import command
from ..device import DeviceFolder, Overrides, parse_overrides
from ..output import (
    OutputOptions,
    console,
    print_json,
    print_lines,
    progress_bars,
    silent_stdout,
    standard_output,
)

if TYPE_CHECKING:
    from ...workflow.study.cord_count import CordCountStudy
    from ...workflow.study.parameter_study import StudyResult, StudyRuns

_DEFAULTS = StudyOptions()
_NO_OUTPUT = OutputOptions()
_MAX_SHOWN_RUNS = 10
_MAX_SHOWN_MEASURES = 5
_MAX_SHOWN_VARIANTS = 6
#: Measures by which variants are compared, as far as runs have them.
_COMPARED = (
    "error",
    "trained",
    "trained_low",
    "trained_high",
    "force",
    "torque",
    "trace_work",
    "cords",
    "parts",
    "r0_low",
    "r0_high",
    "failed_checks",
)

study = command(
    "study",
    "defsense study fixtures/devices/bar --sensors 1..6",
    "defsense study my-device --workers 4",
    "defsense study my-device --scheduler tcp://192.168.1.10:8786",
)


@study.default
def _study(
    folder: DeviceFolder,
    /,
    *,
    overrides: Overrides = (),
    options: Annotated[StudyOptions, Parameter(name="*")] = _DEFAULTS,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Find how many cords a device needs, or vary parameters by study.toml.

    Without a study.toml next to device.toml: find the best layout for each number of cords and
    show how the predicted error decreases. Cords drawn in device.toml are ignored; [design] planes
    applies; with the decoder auto, each number of cords has its best decoder. With a study.toml:
    run all its points, on this machine or on a cluster, and show which parameters matter
    (docs/study.md). Rerun the command to resume an interrupted study.

    Args:
        folder: Folder that contains device.toml.
    """
    from ...workflow.study.study_file import FILE, has_study_file

    parameters = parse_overrides(overrides)
    if has_study_file(folder):
        if options.sensors is not None:
            raise DeviceError(
                f"{options.sensors} conflicts with {folder / FILE}",
                code="options-conflict",
                where="sensors",
                action="Set design.sensors there, or move that file away",
                option="sensors",
            )
        _vary_parameters(folder, parameters, options, output)
        return
    for name in ("workers", "scheduler"):
        if getattr(options, name) is not None:
            raise DeviceError(
                f"applies to the runs of {folder / FILE}, which does not exist",
                code="study-file-missing",
                where=name,
                action="Create the file (docs/study.md), or omit the option",
                option=name,
            )
    _count_cords(folder, parameters, options, output)


def _count_cords(
    folder: Path, parameters: dict[str, Any], options: StudyOptions, output: OutputOptions
) -> None:
    from ...core.device.device_file import load_device
    from ...workflow.study.cord_count import study_cord_count

    device = load_device(folder, parameters)
    with silent_stdout(), progress_bars(output) as progress:
        result = study_cord_count(device, progress, options=options)
    with standard_output():
        if not output.json:
            _print_cord_counts(result, folder)
            return
        rows = [{k: v for k, v in vars(r).items() if k != "cords"} for r in result.rows]
        data = {**vars(result), "rows": rows}
        print_json({k: str(v) if isinstance(v, Path) else v for k, v in data.items()})


def _print_cord_counts(result: CordCountStudy, folder: Path) -> None:
    from rich.table import Table

    table = Table(title="Predicted RMSE (mm) by number of cords")
    for column in ("cords", "unseen", "fitted", "without noise", "affine limit", "decoder", ""):
        table.add_column(column, justify="left" if column in ("decoder", "") else "right")
    for r in result.rows:
        errors = (f"{v:.3f}" for v in (r.unseen, r.rmse, r.rmse_noise_free, r.floor))
        mark = "recommended" if r.sensors == result.knee else ""
        table.add_row(str(r.sensors), *errors, r.decoder, mark)
    console().print(table)
    lines = [f"note: the study ended early: {result.ended}"] if result.ended else []
    print_lines(
        [
            *lines,
            f"note: {result.test_description}",
            f"Look at: {result.picture}",
            f"Next:    set [design] sensors = {result.knee} in {folder / 'device.toml'}, then run"
            f" defsense build {folder}",
        ]
    )


def _vary_parameters(
    folder: Path, parameters: dict[str, Any], options: StudyOptions, output: OutputOptions
) -> None:
    from ...workflow.study.parameter_study import study_parameters

    fixed = {f"body.parameters.{name}": value for name, value in parameters.items()}
    with silent_stdout(), progress_bars(output) as progress:
        result = study_parameters(folder, fixed, progress, options=options)
    with standard_output():
        if output.json:
            print_json(_to_json(result))
        else:
            _print_runs(result, folder)


def _to_json(result: StudyResult) -> dict[str, Any]:
    from msgspec import to_builtins

    failed = [run for runs in result.runs.failures.values() for run in runs]
    return {
        "points": result.points,
        "runs": len(result.runs.done),
        "made": result.new_runs,
        "done": to_builtins(result.runs.done),
        "failed": to_builtins(failed),
        "correlations": result.runs.correlations,
        "file": str(result.file),
        "picture": str(result.picture),
        "best": None if result.best is None else str(result.best),
    }


def _print_runs(result: StudyResult, folder: Path) -> None:
    runs = result.runs
    print_lines([f"{len(runs.done)} runs of {result.points} points, {result.new_runs} of them new"])
    has_few = len(runs.done) <= _MAX_SHOWN_VARIANTS
    is_comparison = bool(runs.study.file.variants) and has_few
    console().print(_compare_runs(runs) if is_comparison else _best_runs(result))
    lines = []
    if runs.correlations:
        name = runs.study.file.main_measure
        lines.append(f"effect of each parameter on {name} (Spearman's coefficient):")
    lines += [f"  {key}: {rho:+.2f}" for key, rho in runs.correlations.items()]
    lines += [
        f"failed: {len(failed)} {'run' if len(failed) == 1 else 'runs'}: {message}"
        for message, failed in runs.failures.items()
    ]
    lines += [f"Look at: {result.picture}", f"Numbers: {result.file}"]
    if result.best is not None:
        lines.append(
            f"Next:    cp {result.best} {folder / 'device.toml'}, to use the best run, then"
            f" defsense build {folder}"
        )
    print_lines(lines)


def _compare_runs(runs: StudyRuns) -> Any:
    """Return a table of runs next to each other, with a row for each parameter and measure."""
    from rich.table import Table

    from ...workflow.study.measures import describe_measure
    from ...workflow.study.parameter_study import format_value

    table = Table(title="Variants")
    keys = [p.key for p in runs.study.parameters]
    table.add_column("")
    for run in runs.done:
        table.add_column(str(run.parameters[keys[0]]), justify="right")
    for key in keys[1:]:
        table.add_row(key, *(format_value(run.parameters.get(key)) for run in runs.done))
    file = runs.study.file
    shown = [file.main_measure, *(m for m in _COMPARED if m in file.measures)]
    for name in dict.fromkeys(shown):
        values = (format_value(run.measures.get(name)) for run in runs.done)
        table.add_row(f"{name}: {describe_measure(name)}", *values)
    return table


def _best_runs(result: StudyResult) -> Any:
    from rich.table import Table

    from ...workflow.study.parameter_study import format_value

    runs, file = result.runs, result.runs.study.file
    first = [m for m in ("error", "cords", "parts", "decoder") if m in file.measures]
    measures = list(dict.fromkeys([file.main_measure, *first, *file.measures]))
    measures = measures[:_MAX_SHOWN_MEASURES]
    keys = [p.key for p in runs.study.parameters]
    table = Table(title=f"Runs with the smallest {file.minimized}" if file.minimized else "Runs")
    for name in (*keys, *measures):
        table.add_column(name, justify="right")
    for run in runs.done[:_MAX_SHOWN_RUNS]:
        values = [run.parameters.get(k) for k in keys] + [run.measures.get(m) for m in measures]
        table.add_row(*map(format_value, values))
    return table
