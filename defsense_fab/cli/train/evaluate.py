"""The command `defsense evaluate`: measure the errors of a trained model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...workflow.train.options import DataFiles, EvaluateOptions
from ..app import command
from ..output import (
    OutputOptions,
    console,
    print_json,
    print_lines,
    progress_bars,
    standard_output,
)
from .data_options import DeviceOption, Files, describe_errors, load_optional_device

if TYPE_CHECKING:
    from ...workflow.train.evaluation import WrittenEvaluation

_NO_FILES = DataFiles()
_NO_OPTIONS = EvaluateOptions()
_NO_OUTPUT = OutputOptions()
_MIN_SHARE = 0.005  # of the squared error; causes with less are not printed

evaluate = command(
    "evaluate",
    "defsense evaluate my-device/model.json my-device/session-2",
    "defsense evaluate model.json session --against affine.json --last-share 0.3 --json",
    "defsense evaluate model.json --signals signals.csv --tracks take.c3d --offset auto"
    " --device my-device",
)


@evaluate.default
def _evaluate(
    model: Path,
    /,
    files: Files = _NO_FILES,
    *,
    options: Annotated[EvaluateOptions, Parameter(name="*", consume_multiple=True)] = _NO_OPTIONS,
    device: DeviceOption = None,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Measure the errors of a trained model, by pose, marker, speed and cause.

    Report RMSE, peak and average peak as in DefSense's Table 1, by pose, marker, speed and time;
    whether the intervals hold; and the shares of the error due to noise, clocks, gains, drift, the
    decoder, hysteresis and untrained poses. With other models, report whether they differ. Write a
    page, figures (SVG) and tables (CSV).

    Args:
        model: Read this model file (model.json), or the one in this folder.
    """
    from ...workflow.train.evaluation import evaluate as evaluate_model

    with progress_bars(output) as progress:
        evaluation = evaluate_model(model, files, load_optional_device(device), options, progress)
    with standard_output():
        if output.json:
            print_json(evaluation.to_json(), allow_nan=False)
            return
        if evaluation.useless:
            print_lines([f"warning: {evaluation.useless}"])
        _print_errors(evaluation)
        print_lines(_describe_first(evaluation))
        if evaluation.result.likeness is not None:
            print_lines(f"signals: {text}" for text in evaluation.result.likeness.sentences)
        print_lines(f"note: {note}" for note in evaluation.result.notes)
        print_lines([f"Look at: {evaluation.page}"])


def _print_errors(evaluation: WrittenEvaluation) -> None:
    """Print the errors of all models, and the published ones."""
    from rich.table import Table

    first, published = evaluation.result.models[0], evaluation.published_errors
    unit = f" ({first.unit_text})" if len({m.unit for m in evaluation.result.models}) == 1 else ""
    source = f"; paper: {evaluation.publication}" if published else ""
    table = Table(title=f"Errors of {first.noun}s{unit}{source}")
    table.add_column("", no_wrap=True)
    for name in ("RMSE ± SD", "peak", "average peak", "frames"):
        table.add_column(name, justify="right", no_wrap=True)
    rows = {m.name: m.evaluation.total for m in evaluation.result.models}
    for name, t in (rows | published).items():
        errors = f"{t.rmse:.2f} ± {t.deviation:.2f}", f"{t.peak:.2f}", f"{t.average_peak:.2f}"
        table.add_row(name, *errors, str(t.frames))
    console().print(table)


def _describe_first(evaluation: WrittenEvaluation) -> list[str]:
    """Return lines on the causes and intervals of the first model, and the comparison."""
    first = evaluation.result.models[0]
    e, budget = first.evaluation, first.budget
    lines = []
    if first.grade:
        lines.append(f"error of {first.name}: {first.grade}")
    if first.model.targets is not None:
        models = [m for m in evaluation.result.models if m.errors is not None]
        lines += [f"{m.name}: {describe_errors(m.errors)}" for m in models if m.errors]
    if e.rmse_without_noise is not None:
        lines.append(
            f"without the noise of the cameras ({e.camera_noise:.2f} mm): RMSE"
            f" {e.rmse_without_noise:.2f} mm"
        )
    if (c := e.coverage) is not None and first.model.targets is None:
        lines.append(
            f"{100 * c.level:.0f} % intervals contain {100 * c.share:.1f} % of the errors,"
            f" ± {c.radius:.2f} mm"
        )
    if budget.total > 0:
        shares = sorted(budget.shares.items(), key=lambda item: -item[1])
        causes = [
            f"{cause} {100 * share / budget.total:.0f} %"
            for cause, share in shares
            if abs(share) >= _MIN_SHARE * budget.total
        ]
        is_too_much = shares[-1][1] <= -_MIN_SHARE * budget.total
        why = "; negative: causes overlap, or a noise is stated larger than it is"
        lines.append(f"squared error by cause: {', '.join(causes)}{why if is_too_much else ''}")
    if (p := first.predicted) is not None:
        lines.append(
            f"From the training recordings: {p.predicted:.2f} mm expected. Measured:"
            f" {p.measured:.2f} mm; expected / measured {p.ratio:.2f}."
        )
    if evaluation.expected:
        lines.append(evaluation.expected)
    return [*lines, evaluation.verdict] if evaluation.verdict else lines
