"""Command `defsense evaluate`: measure the errors of a trained model."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import TrainingError
from ..options import add_output_options
from ..output import console, print_json, print_lines, progress_bars, standard_output
from .data_arguments import add_data_arguments, read_data_arguments

if TYPE_CHECKING:
    from ...training.evaluation.evaluate_models import SessionEvaluation
    from ..options import Commands


def add(commands: Commands) -> None:
    """Add `evaluate`."""
    sub = commands.add_parser(
        "evaluate",
        help="Measure the errors of a trained model, by pose, marker, speed and cause",
        description="Test a trained model on recorded sessions. Report RMSE, peak and average peak"
        " as in DefSense's Table 1, by pose, marker, speed and time; whether the "
        "intervals hold; and the shares of the error due to noise, clocks, gains, "
        "drift, the decoder, hysteresis and untrained poses. With other models, report"
        " whether they differ. Write a page, figures (SVG) and tables (CSV).",
        examples=[
            "defsense evaluate my-device/model.json my-device/session-2",
            "defsense evaluate model.json session --against affine.json --last-share 0.3 --json",
            "defsense evaluate model.json --signals signals.csv --tracks take.c3d --offset auto"
            " --device my-device",
        ],
    )
    sub.add_argument(
        "model", type=Path, metavar="MODEL", help="Model file (model.json), or its folder"
    )
    add_data_arguments(sub)
    sub.add_argument(
        "--against",
        action="extend",
        nargs="+",
        type=Path,
        default=[],
        metavar="MODEL",
        help="Compare with these models, tested on the same data",
    )
    sub.add_argument(
        "--last-share",
        type=float,
        metavar="X",
        help="Test on this share of the pictures, at the end (default: all that the models "
        "were not trained on)",
    )
    sub.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="Set the output folder (default: evaluation, next to the model)",
    )
    add_output_options(sub)
    sub.set_defaults(run=_evaluate)


def _evaluate(options: argparse.Namespace) -> int:
    share = options.last_share
    if share is not None and not 0 < share <= 1:
        raise TrainingError(
            f"{share:g} is out of range",
            code="out-of-range",
            where="--last-share",
            action="Give a share above 0, up to 1",
            value=share,
        )
    from ...core.device.device_file import load_device
    from ...report.evaluation.evaluation_report import check_folder, write_evaluation
    from ...report.evaluation.tables import as_data
    from ...training.evaluation.evaluate_models import evaluate_files

    files = read_data_arguments(options)
    if files is None:
        raise TrainingError(
            "there are no data to test on",
            code="sources-missing",
            action="Give sessions, or --signals with --tracks",
        )
    device = load_device(options.device) if options.device else None
    models = [options.model, *options.against]
    parent = options.model if options.model.is_dir() else options.model.parent
    folder = options.out or parent / "evaluation"
    check_folder(folder)
    with progress_bars(options) as progress:
        result = evaluate_files(models, files, device, share, progress)
        progress("report", 0.0, "figures and tables")
        write_evaluation(folder, result)
        progress("report", 1.0, "done")
    with standard_output():
        if options.json:
            data = {"folder": str(folder), **as_data(result)}
            print_json(data, allow_nan=False)
        else:
            _print_evaluation(result, folder)
    return 0


def _print_evaluation(result: SessionEvaluation, folder: Path) -> None:
    from rich.table import Table

    from ...report.evaluation.evaluation_report import PAGE, verdict
    from ...report.evaluation.tables import PAPER, SOURCE

    out = console()
    table = Table(title=f"Errors of markers (mm); paper: {SOURCE}")
    table.add_column("", no_wrap=True)
    for name in ("RMSE ± SD", "peak", "average peak", "frames"):
        table.add_column(name, justify="right", no_wrap=True)
    rows = [(m.name, m.evaluation.total) for m in result.models]
    rows += [(f"paper: {name}", row) for name, row in PAPER.items()]
    for name, t in rows:
        numbers = f"{t.rmse:.2f} ± {t.deviation:.2f}", f"{t.peak:.2f}", f"{t.average_peak:.2f}"
        table.add_row(name, *numbers, str(t.frames))
    out.print(table)
    first = result.models[0]
    e, budget = first.evaluation, first.budget
    shares = sorted(budget.shares.items(), key=lambda item: -item[1])
    lines = []
    if e.rmse_without_noise is not None:
        lines.append(
            f"without the noise of the cameras ({e.camera_noise:.2f} mm): RMSE"
            f" {e.rmse_without_noise:.2f} mm"
        )
    if e.coverage is not None:
        c = e.coverage
        lines.append(
            f"{100 * c.level:.0f} % intervals contain {100 * c.share:.1f} % of the errors,"
            f" ± {c.radius:.2f} mm"
        )
    if budget.total > 0:
        causes = ", ".join(f"{cause} {100 * s / budget.total:.0f} %" for cause, s in shares
                         if abs(s) >= 0.005 * budget.total)  # fmt: skip
        lines.append(f"squared error by cause: {causes}")
    if (p := first.predicted) is not None:
        design_error = "" if p.design is None else f"; design only, {p.design.rmse:.2f} mm"
        lines.append(
            f"predicted {p.predicted:.2f} mm, measured {p.measured:.2f} mm: ratio {p.ratio:.2f}"
            f"{design_error}"
        )
    if result.comparison is not None:
        lines.append(verdict(result.comparison))
    print_lines(lines)
    print_lines([f"note: {n}" for n in result.notes])
    print_lines([f"Look at: {folder / PAGE}"])
