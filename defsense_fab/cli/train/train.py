"""The command `defsense train`: train a model on sessions or on the simulation."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...workflow.train.options import DataFiles, TrainOptions
from ..app import command
from ..output import (
    OutputOptions,
    console,
    print_json,
    print_lines,
    progress_bars,
    standard_output,
)
from .data_options import (
    DeviceOption,
    Files,
    describe_errors,
    format_data_options,
    load_optional_device,
)

if TYPE_CHECKING:
    from ...workflow.train.training import Training

_NO_FILES = DataFiles()
_NO_OPTIONS = TrainOptions()
_NO_OUTPUT = OutputOptions()

train = command(
    "train",
    "defsense train my-device/session --device my-device",
    "defsense train --signals signals.csv --tracks aligned.csv --device my-device"
    " --out model.json --json",
    "defsense train --signals walk-1.csv walk-2.csv --targets angles-1.csv angles-2.csv"
    " --leave-out walk-2 --out model.json",
    "defsense train --device my-device",
)


@train.default
def _train(
    files: Files = _NO_FILES,
    *,
    options: Annotated[TrainOptions, Parameter(name="*")] = _NO_OPTIONS,
    device: DeviceOption = None,
    out: Annotated[Path | None, Parameter(metavar="JSON")] = None,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Train a model that converts resistances to marker positions.

    Train on processed sessions: the first 70 % of the pictures, in time, are for training, the
    last 30 % for testing. Contiguous folds choose the ridge weight and the decoder: affine
    (DefSense's, always in the table), quadratic, kernel, each also with a memory of the cords'
    past. With a built device, simulated states are also used for training, as far as they improve
    the folds. Without any session, the model is based on the simulation only.

    No device is needed: train on any tables of signals (resistances, capacitances, voltages, raw
    counts) and targets (angles, forces, positions). Units are in the headers, such as angle_deg.

    Args:
        out: Set the output file (default: model.json, in the folder of the device or session).
    """
    from ...workflow.train.training import errors_to_json, train_files

    with progress_bars(output) as progress:
        trained = train_files(
            files, load_optional_device(device), options, out=out, progress=progress
        )
    path, model, notes = trained.path, trained.model, list(trained.notes)
    with standard_output():
        if output.json:
            decoder = {} if trained.training else {"decoder": model.kind}
            errors = () if trained.training is None else trained.training.test
            result = {"model": str(path), "notes": notes, **decoder, **model.metadata}
            print_json({**result, "test": errors_to_json(errors)})
        elif trained.training is None:
            print_lines(
                [
                    f"{path}: {model.kind}, from {model.metadata['trained_on']}. Cords differ, and"
                    " this device was not measured: expect errors of several times the prediction"
                    " until it is trained.",
                    f"Next:    defsense run {path} --port twin --view, with a simulated device",
                    f"Then:    defsense capture record {device} (or without hardware defsense twin"
                    f" {device}), and defsense train SESSION --device {device}",
                ]
            )
        else:
            if (judgment := trained.training.usefulness) is not None and judgment.is_useless:
                print_lines([f"warning: {judgment.message} The model is written all the same."])
            _print_errors(trained.training)
            grade = "" if judgment is None else judgment.error_in_words(judgment.error)
            if grade:
                print_lines([f"error on the test: {grade}"])
            notes = [*_describe_training(trained.training), *notes]
            print_lines(f"note: {note}" for note in notes)
            words = format_data_options(files, device)
            next_command = f"defsense evaluate {quote(str(path))} {words}"
            print_lines([f"Wrote:   {path}", f"Next:    {next_command}"])


def _print_errors(training: Training) -> None:
    """Print the errors of all decoders."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    units = tuple(dict.fromkeys(training.model.units))
    what = "targets" if training.model.targets else "markers"
    unit = units[0] or "no unit given"
    title = f"Errors of {what} ({unit}): RMSE ± SD, peaks of the test"
    if len(units) > 1:
        title = f"Errors: folds as shares of the spread; test of targets in {unit}"
    table = Table(title=title, box=SIMPLE_HEAD)
    table.add_column("decoder", no_wrap=True)
    for name in ("folds", "test", "peak", "mean peak"):
        table.add_column(name, justify="right", no_wrap=True)
    for c in training.candidates:
        errors = ["-"] * 3
        if c.test is not None:
            rmse = f"{c.test.rmse:.2f} ± {c.test.per_state.std():.2f}"
            errors = [rmse, f"{c.test.peak:.2f}", f"{c.test.average_peak:.2f}"]
        mark = "*" if c.name == training.selected else " "
        table.add_row(f"{mark} {c.name}", f"{c.cross_validated:.2f}", *errors)
    console().print(table)


def _describe_training(training: Training) -> list[str]:
    """Return notes on the frames, the memory and the wrong markers of a training."""
    selected = next(c for c in training.candidates if c.name == training.selected)
    what, truth, following = "pictures", "tracks", "the following "
    targets = training.model.targets
    if targets is not None:
        what, truth, following = "rows of the targets", "targets", ""
    kinds = "markers" if targets is None else "values"
    notes = [
        "*: selected by cross-validation",
        f"trained on {len(training.training_frames)} {what}, tested on {following}"
        f"{len(training.test_frames)}",
    ]
    if targets is not None:
        notes += [describe_errors(e) for e in training.test]
    if selected.moved or selected.worked:
        memories = {"of positions": selected.moved, "of travel": selected.worked}
        texts = [f"{', '.join(f'{t:.2g}' for t in m)} s {of}" for of, m in memories.items() if m]
        notes.append(f"memory: {'; '.join(texts)}")
    if training.wrong_markers.any():
        share = training.wrong_markers.sum() / max(int(training.training_frames.visible.sum()), 1)
        notes.append(f"{share:.2%} of the {kinds} were wrong and excluded from the training")
    if training.wrong_test_markers.any():
        visible = int(training.test_frames.visible.sum())
        share = training.wrong_test_markers.sum() / max(visible, 1)
        notes.append(
            f"{share:.2%} of the {kinds} of the test seem wrong, and its errors include them. Check"
            f" the {truth}."
        )
    return notes
