"""Command `defsense recalibrate`: correct the gains of a model."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ..options import add_output_options
from ..output import console, print_json, print_lines, standard_output

if TYPE_CHECKING:
    from ..options import Commands


def add(commands: Commands) -> None:
    """Add `recalibrate`."""
    sub = commands.add_parser(
        "recalibrate",
        help="Correct a model after a cord was replaced or has aged",
        description="Correct the gain of each channel of a model from a short session of a few "
        "poses and rest, which needs no camera. Move the device for half a minute "
        "before. If the correction is not sufficient, the command reports it and "
        "writes no model. Show the poses that the model was trained on, with about the"
        " same amplitude: 'defsense capture record my-device --cameras none --port "
        "/dev/ttyUSB0 --rounds 3 --seconds 5 --free 0 --rest 5 --out routine'.",
        examples=["defsense recalibrate my-device/model.json routine"],
    )
    sub.add_argument(
        "model", type=Path, metavar="MODEL", help="Model file (model.json), or its folder"
    )
    sub.add_argument(
        "sessions", nargs="+", type=Path, metavar="SESSION", help="Recorded sessions of the routine"
    )
    sub.add_argument(
        "--out",
        type=Path,
        metavar="JSON",
        help="Set the output file (default: recalibrated.json, next to the model)",
    )
    add_output_options(sub)
    sub.set_defaults(run=_recalibrate)


def _recalibrate(options: argparse.Namespace) -> int:
    from ...training.models.model_file import MODEL, load_model, write_model
    from ...training.models.recalibration_routine import recalibrate_from
    from ...training.models.train_device import choose_model_path

    model = load_model(options.model)
    parent = options.model if options.model.is_dir() else options.model.parent
    path = choose_model_path(options.out or parent / f"recalibrated{Path(MODEL).suffix}", None, [])
    result = recalibrate_from(model, options.sessions)
    if not result.problems:
        write_model(path, result.model)
    with standard_output():
        if options.json:
            written = None if result.problems else str(path)
            data = {"model": written, "enough": not result.problems, **result.to_json()}
            print_json(data)
            return 0
        from rich.table import Table

        table = Table(title="Changes since the training")
        for name in ("channel", "gain"):
            table.add_column(name, justify="left" if name == "channel" else "right")
        for name, gain, error in zip(model.channels, result.gain, result.gain_error, strict=True):
            table.add_row(name, f"{gain:.3f} ± {error:.3f}")
        console().print(table)
        print_lines([f"warning: {p}" for p in (*result.problems, *result.notes)])
        if result.problems:
            print_lines(["No model was written: correcting the gains is not sufficient.",
                 "Next:    defsense capture record ..., then defsense train"])  # fmt: skip
        else:
            print_lines([f"Wrote:   {path}", f"Next:    defsense evaluate {path} SESSION"])
    return 0
