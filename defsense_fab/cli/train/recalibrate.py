"""The command `defsense recalibrate`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..output import console, results, say

if TYPE_CHECKING:
    from ..options import Commands


def add(commands: Commands) -> None:
    """`recalibrate`."""
    sub = commands.add_parser(
        "recalibrate",
        help="correct a model after a cord was replaced or has aged",
        description="Correct the gain of each channel of a model by a short session of a few poses"
        " and rest, which needs no camera, after the device was moved for half a minute; says when"
        " that is not enough, and writes no model then. The poses are those that the model was"
        " trained on, shown about as far: 'defsense capture record my-device --cameras none --port"
        " /dev/ttyUSB0 --rounds 3 --seconds 5 --free 0 --rest 5 --out routine'.",
        examples=["defsense recalibrate my-device/model.json routine"],
    )
    sub.add_argument("model", type=Path, metavar="MODEL", help="model.json, or its folder")
    sub.add_argument("sessions", nargs="+", type=Path, metavar="SESSION", help="the routine's")
    sub.add_argument("--out", type=Path, metavar="JSON",
                     help="the corrected model (recalibrated.json, beside the model)")  # fmt: skip
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=_recalibrate)


def _recalibrate(options: argparse.Namespace) -> int:
    from ...training.models.model_file import MODEL, load_model, write_model
    from ...training.models.recalibration_routine import recalibrate_from
    from ...training.models.train_device import choose_model_path

    model = load_model(options.model)
    beside = options.model if options.model.is_dir() else options.model.parent
    path = choose_model_path(options.out or beside / f"recalibrated{Path(MODEL).suffix}", None, [])
    found = recalibrate_from(model, options.sessions)
    if not found.problems:
        write_model(path, found.model)
    with results():
        if options.json:
            written = None if found.problems else str(path)
            told = {"model": written, "enough": not found.problems, **found.to_json()}
            sys.stdout.write(json.dumps(told, indent=1) + "\n")
            return 0
        from rich.table import Table

        table = Table(title="what has changed since the training")
        for name in ("channel", "gain"):
            table.add_column(name, justify="left" if name == "channel" else "right")
        for name, gain, error in zip(model.channels, found.gain, found.gain_error, strict=True):
            table.add_row(name, f"{gain:.3f} ± {error:.3f}")
        console().print(table)
        say([f"warning: {p}" for p in (*found.problems, *found.notes)])
        if found.problems:
            say(["No model was written: gains do not suffice.",
                 "Next:    defsense capture record ..., then defsense train"])  # fmt: skip
        else:
            say([f"Wrote:   {path}", f"Next:    defsense evaluate {path} SESSION"])
    return 0
