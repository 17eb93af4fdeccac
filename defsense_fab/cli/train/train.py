"""Command `defsense train`: train a model on sessions or on the simulation."""

from __future__ import annotations

import argparse
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ...core.errors import TrainingError
from ..options import add_output_options
from ..output import console, print_json, print_lines, progress_bars, standard_output
from .data_arguments import add_data_arguments, format_data_arguments, read_data_arguments

if TYPE_CHECKING:
    from ...core.device.device import Device
    from ...training.fitting.train_model import Training
    from ..options import Commands


def add(commands: Commands) -> None:
    """Add `train`."""
    sub = commands.add_parser(
        "train",
        help="Train a model that converts resistances to marker positions",
        description="Train on processed sessions: the first 70 % of the pictures, in time, are for"
        " training, the last 30 % for testing. Contiguous folds choose the ridge "
        "weight and the decoder: affine (DefSense's, always in the table), quadratic, "
        "kernel, each also with a memory of the cords' past. With a built device, "
        "simulated states are also used for training, as far as they improve the "
        "folds. Without any session, the model is based on the simulation only.",
        examples=[
            "defsense train my-device/session --device my-device",
            "defsense train --signals signals.csv --tracks aligned.csv --device my-device"
            " --out model.json --json",
            "defsense train --device my-device",
        ],
    )
    add_data_arguments(sub)
    sub.add_argument(
        "--without-markers", default="", metavar="ID,...", help="Leave out these markers"
    )
    sub.add_argument(
        "--decoder",
        default="auto",
        metavar="NAME",
        help="Choose the decoder: auto (default), affine, quadratic or kernel",
    )
    sub.add_argument("--no-memory", action="store_true", help="Use only decoders without memory")
    sub.add_argument(
        "--unweighted",
        action="store_true",
        help="Give all markers the same weight, including wrong ones",
    )
    sub.add_argument(
        "--prior",
        default="auto",
        metavar="auto|yes|no",
        help="Train on the device's simulation too: auto (if built, default), yes or no",
    )
    sub.add_argument(
        "--test-share",
        type=float,
        default=0.3,
        metavar="X",
        help="Set the share of the pictures, at the end, to test on (default: 0.3)",
    )
    sub.add_argument(
        "--folds",
        type=int,
        default=5,
        metavar="K",
        help="Set the number of contiguous folds (default: 5)",
    )
    sub.add_argument(
        "--level",
        type=float,
        default=0.9,
        metavar="P",
        help="Set the probability of the intervals (default: 0.9)",
    )
    sub.add_argument(
        "--out",
        type=Path,
        metavar="JSON",
        help="Set the output file (default: model.json, in the folder of the device or session)",
    )
    add_output_options(sub)
    sub.set_defaults(run=_train)


def _train(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device

    device = load_device(options.device) if options.device else None
    files = read_data_arguments(options)
    if files is None:
        if device is None:
            raise TrainingError(
                "there are no data to train on",
                code="sources-missing",
                action="Give sessions, --signals with --tracks, or --device to use its simulation",
            )
        return _train_on_simulation(options, device)
    from ...training.fitting.train_model import TrainingOptions
    from ...training.models.train_device import train_files

    training_options = TrainingOptions(
        options.decoder, not options.no_memory, not options.unweighted, options.test_share,
        options.folds, options.level,
    )  # fmt: skip
    with progress_bars(options) as progress:
        trained = train_files(
            files, device, training_options, out=options.out, prior_mode=options.prior,
            excluded_markers=_parse_ids(options.without_markers), progress=progress,
        )  # fmt: skip
    path, result, notes = trained.path, trained.training, list(trained.notes)
    with standard_output():
        if options.json:
            data = {"model": str(path), "notes": notes, **result.model.metadata}
            print_json(data)
        else:
            _print_training(result, path, options, notes)
    return 0


def _parse_ids(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise TrainingError(
            f"{text} is not a list of numbers",
            code="not-a-number",
            where="--without-markers",
            action="Give numbers, such as 4,7",
            value=text,
        ) from None


def _train_on_simulation(options: argparse.Namespace, device: Device) -> int:
    from ...training.models.model_file import write_model
    from ...training.models.train_device import choose_model_path, simulate_only

    path = choose_model_path(options.out, device, [])
    model = simulate_only(device)
    write_model(path, model)
    with standard_output():
        if options.json:
            data = {"model": str(path), "decoder": model.kind, **model.metadata}
            print_json(data)
            return 0
        print_lines([
            f"{path}: {model.kind}, from {model.metadata['trained_on']}. Cords differ, and this"
            " device was not measured: expect errors of several times the prediction until it is"
            " trained.",
            f"Next:    defsense capture record {options.device} ..., then defsense train SESSION"
            f" --device {options.device}",
        ])  # fmt: skip
    return 0


def _print_training(
    result: Training, path: Path, options: argparse.Namespace, notes: list[str]
) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    out = console()
    table = Table(title="Errors of markers (mm): RMSE ± SD, peaks of the test", box=SIMPLE_HEAD)
    table.add_column("decoder", no_wrap=True)
    for name in ("folds", "test", "peak", "mean peak"):
        table.add_column(name, justify="right", no_wrap=True)
    for a in result.candidates:
        test = ["-"] * 3
        if a.test is not None:
            sd = a.test.per_state.std()
            test = [f"{a.test.rmse:.2f} ± {sd:.2f}", f"{a.test.peak:.2f}",
                    f"{a.test.average_peak:.2f}"]  # fmt: skip
        mark = "*" if a.name == result.selected else " "
        table.add_row(f"{mark} {a.name}", f"{a.cross_validated:.2f}", *test)
    out.print(table)
    selected = next(a for a in result.candidates if a.name == result.selected)
    notes_on_training = [
        "*: selected by cross-validation",
        f"trained on {len(result.training_frames)} pictures, tested on the following"
        f" {len(result.test_frames)}",
    ]
    if selected.moved or selected.worked:
        times = [f"{t:.2g} s" for t in (*selected.moved, *selected.worked)]
        notes_on_training.append(f"memory: {', '.join(times)}")
    if result.wrong_markers.any():
        share = result.wrong_markers.sum() / max(int(result.training_frames.visible.sum()), 1)
        notes_on_training.append(
            f"{share:.2%} of the markers were wrong and excluded from the training"
        )
    if result.wrong_test_markers.any():
        share = result.wrong_test_markers.sum() / max(int(result.test_frames.visible.sum()), 1)
        notes_on_training.append(
            f"{share:.2%} of the markers of the test seem wrong, and its errors include them. Check"
            " the tracks."
        )
    print_lines([f"note: {n}" for n in [*notes_on_training, *notes]])
    print_lines([
        f"Wrote:   {path}",
        f"Next:    defsense evaluate {quote(str(path))} {format_data_arguments(options)}",
    ])  # fmt: skip
