"""The command `defsense recalibrate`: correct the gains of a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ..app import command
from ..output import OutputOptions, console, print_json, print_lines, standard_output

if TYPE_CHECKING:
    from ...workflow.train.recalibration import WrittenRecalibration

_NO_OUTPUT = OutputOptions()

recalibrate = command("recalibrate", "defsense recalibrate my-device/model.json routine")


@recalibrate.default
def _recalibrate(
    model: Path,
    sessions: Annotated[tuple[Path, ...], Parameter(negative=())],
    /,
    *,
    out: Annotated[Path | None, Parameter(metavar="JSON")] = None,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Correct a model after a cord was replaced or has aged.

    Correct the gain of each channel of a model from a short session of a few poses and rest, which
    needs no camera. Move the device for half a minute before. If the correction is not sufficient,
    the command reports it and writes no model. Show the poses that the model was trained on, with
    about the same amplitude: 'defsense capture record my-device --cameras none --port /dev/ttyUSB0
    --rounds 3 --seconds 5 --free 0 --rest 5 --out routine'.

    Args:
        model: Read this model file (model.json), or the one in this folder.
        sessions: Read these recorded sessions of the routine.
        out: Set the output file (default: recalibrated.json, next to the model).
    """
    from ...workflow.train.recalibration import recalibrate as recalibrate_model

    written = recalibrate_model(model, sessions, out)
    path, result = written.path, written.result
    with standard_output():
        if output.json:
            data = {"model": None if path is None else str(path), "enough": path is not None}
            print_json({**data, **result.to_json()})
            return
        _print_gains(written)
        print_lines(f"warning: {text}" for text in (*result.problems, *result.notes))
        if path is None:
            print_lines(
                [
                    "No model was written: correcting the gains is not sufficient.",
                    "Next:    defsense capture record ..., then defsense train",
                ]
            )
        else:
            print_lines([f"Wrote:   {path}", f"Next:    defsense evaluate {path} SESSION"])


def _print_gains(written: WrittenRecalibration) -> None:
    from rich.table import Table

    result = written.result
    table = Table(title="Changes since the training")
    for name in ("channel", "gain"):
        table.add_column(name, justify="left" if name == "channel" else "right")
    rows = zip(result.model.channels, result.gain, result.gain_error, strict=True)
    for name, gain, error in rows:
        table.add_row(name, f"{gain:.3f} ± {error:.3f}")
    console().print(table)
