"""The command `defsense train`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ...core.errors import TrainingError
from ..output import console, progress_bars, results, say
from .data_arguments import data_arguments, data_given, data_words

if TYPE_CHECKING:
    from ...core.device.device import Device
    from ...training.fitting.train_model import Training
    from ..options import Commands


def add(commands: Commands) -> None:
    """`train`."""
    sub = commands.add_parser(
        "train",
        help="a model from recorded sessions: resistances to marker positions",
        description="Train on processed sessions: the first 70 % of the pictures, in time, for"
        " training, the last 30 % for testing. Contiguous folds choose the ridge's weight and the"
        " decoder: affine (DefSense's, always in the table), quadratic, kernel, each also with a"
        " memory of what the cords did before. With a built device, what the simulation says is"
        " trained on, too, as far as the folds find it worth; without any session the model is the"
        " simulation's alone.",
        examples=[
            "defsense train my-device/session --device my-device",
            "defsense train --signals signals.csv --tracks aligned.csv --device my-device"
            " --out model.json --json",
            "defsense train --device my-device",
        ],
    )
    data_arguments(sub)
    sub.add_argument("--without-markers", default="", metavar="ID,...",
                     help="markers to leave out")  # fmt: skip
    sub.add_argument("--decoder", default="auto", metavar="NAME",
                     help="auto, affine, quadratic or kernel (auto)")  # fmt: skip
    sub.add_argument("--no-memory", action="store_true",
                     help="only decoders that see the present")  # fmt: skip
    sub.add_argument("--unweighted", action="store_true",
                     help="all markers count the same, wrong ones too")  # fmt: skip
    sub.add_argument("--prior", default="auto", metavar="auto|yes|no",
                     help="train on the device's simulation, too (auto: if built)")  # fmt: skip
    sub.add_argument("--test-share", type=float, default=0.3, metavar="X",
                     help="of the pictures, at the end, to test on (0.3)")  # fmt: skip
    sub.add_argument("--folds", type=int, default=5, metavar="K", help="contiguous folds (5)")
    sub.add_argument("--level", type=float, default=0.9, metavar="P",
                     help="of the intervals (0.9)")  # fmt: skip
    sub.add_argument("--out", type=Path, metavar="JSON",
                     help="the model (model.json, of the device or session)")  # fmt: skip
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=_train)


def _train(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device

    device = load_device(options.device) if options.device else None
    files = data_given(options)
    if files is None:
        if device is None:
            raise TrainingError(
                "nothing to train on: give sessions, --signals with --tracks, or --device for the"
                " simulation's own model"
            )
        return _simulated(options, device)
    from ...training.fitting.train_model import TrainingOptions
    from ...training.models.train_device import train_files

    how = TrainingOptions(
        options.decoder, not options.no_memory, not options.unweighted, options.test_share,
        options.folds, options.level,
    )  # fmt: skip
    with progress_bars(options) as progress:
        trained = train_files(
            files, device, how, out=options.out, prior_mode=options.prior,
            excluded_markers=_numbers(options.without_markers), progress=progress,
        )  # fmt: skip
    path, result, notes = trained.path, trained.training, list(trained.notes)
    with results():
        if options.json:
            told = {"model": str(path), "notes": notes, **result.model.metadata}
            sys.stdout.write(json.dumps(told, indent=1) + "\n")
        else:
            _show(result, path, options, notes)
    return 0


def _numbers(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise TrainingError(f"--without-markers {text}: give numbers, such as 4,7") from None


def _simulated(options: argparse.Namespace, device: Device) -> int:
    from ...training.models.model_file import write_model
    from ...training.models.train_device import choose_model_path, simulate_only

    path = choose_model_path(options.out, device, [])
    model = simulate_only(device)
    write_model(path, model)
    with results():
        if options.json:
            told = {"model": str(path), "decoder": model.kind, **model.metadata}
            sys.stdout.write(json.dumps(told, indent=1) + "\n")
            return 0
        say([
            f"{path}: {model.kind}, from {model.metadata['trained_on']}. Cords differ, and nothing of"
            " this one was measured: expect errors of several times the prediction until it is"
            " trained.",
            f"Next:    defsense capture record {options.device} ..., then defsense train SESSION"
            f" --device {options.device}",
        ])  # fmt: skip
    return 0


def _show(result: Training, path: Path, options: argparse.Namespace, notes: list[str]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    out = console()
    table = Table(title="errors of markers, mm (RMSE ± SD, peaks of the test)", box=SIMPLE_HEAD)
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
    chosen = next(a for a in result.candidates if a.name == result.selected)
    about = [
        "*: chosen by the folds",
        f"trained on {len(result.training_frames)} pictures, tested on the {len(result.test_frames)} after",
    ]
    if chosen.moved or chosen.worked:
        times = [f"{t:.2g} s" for t in (*chosen.moved, *chosen.worked)]
        about.append(f"memory: {', '.join(times)}")
    if result.wrong_markers.any():
        share = result.wrong_markers.sum() / max(int(result.training_frames.visible.sum()), 1)
        about.append(f"{share:.2%} of the markers were wrong, and left out of the training")
    if result.wrong_test_markers.any():
        share = result.wrong_test_markers.sum() / max(int(result.test_frames.visible.sum()), 1)
        about.append(
            f"{share:.2%} of the markers of the test seem wrong; its errors are with them: look at"
            " the tracks"
        )
    say([f"note: {n}" for n in [*about, *notes]])
    say([
        f"Wrote:   {path}",
        f"Next:    defsense evaluate {quote(str(path))} {data_words(options)}",
    ])  # fmt: skip
