"""Command `defsense dataset`: export sessions as a dataset."""

from __future__ import annotations

import argparse
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ...core.errors import TrainingError
from ..options import add_output_options, check_range
from ..output import print_json, print_lines, progress_bars, standard_output
from .data_arguments import add_data_arguments, read_data_arguments

if TYPE_CHECKING:
    from ...training.models.prepare import Exported
    from ..options import Commands


def add(commands: Commands) -> None:
    """Add `dataset`."""
    sub = commands.add_parser(
        "dataset",
        help="Export sessions and files as a dataset (Parquet, or LeRobot's format)",
        description="Write the data that training uses to a folder: all samples of the read-out "
        "board and all marker positions, with units, R0, clocks, poses and provenance."
        " The commands train, evaluate and dataset accept the folder instead of "
        "sessions. Problems of the data are reported; no data are left out.",
        examples=[
            "defsense dataset my-device/session --device my-device --out my-device/data",
            "defsense dataset --signals signals.csv --tracks take.c3d --offset auto --out data",
            "defsense dataset my-device/session --lerobot policy-data --rate 30",
        ],
    )
    add_data_arguments(sub)
    sub.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="Set the output folder for Parquet; an existing dataset is replaced",
    )
    sub.add_argument(
        "--lerobot",
        type=Path,
        metavar="DIR",
        help="Set the output folder for LeRobot's format 2.1; it must not exist",
    )
    sub.add_argument(
        "--rate",
        type=int,
        metavar="HZ",
        help="Set the rate of LeRobot's frames in Hz (default: that of the pictures)",
    )
    add_output_options(sub)
    sub.set_defaults(run=_dataset)


def _dataset(options: argparse.Namespace) -> int:
    files = read_data_arguments(options)
    if files is None:
        raise TrainingError(
            "there are no data to export",
            code="sources-missing",
            action="Give sessions, or --signals with --tracks",
        )
    if options.out is None and options.lerobot is None:
        raise TrainingError(
            "there is no output",
            code="output-missing",
            action="Give --out FOLDER, --lerobot FOLDER, or both",
        )
    if options.rate is not None:
        if options.lerobot is None:
            raise TrainingError(
                "applies to --lerobot only; Parquet keeps the original times",
                code="options-conflict",
                where="--rate",
                action="Omit the option, or give --lerobot",
                option="--rate",
            )
        check_range("--rate", options.rate, 1, 1000)
    from ...core.device.device_file import load_device
    from ...training.models.prepare import export_dataset

    device = load_device(options.device) if options.device else None
    with progress_bars(options) as progress:
        exported = export_dataset(
            files, device, parquet=options.out, lerobot=options.lerobot, rate=options.rate,
            progress=progress,
        )  # fmt: skip
    with standard_output():
        if options.json:
            print_json(_to_json(exported, options), allow_nan=False)
        else:
            _print_exported(exported, options)
    return 0


def _to_json(exported: Exported, options: argparse.Namespace) -> dict[str, object]:
    dataset = exported.dataset
    return {
        "parquet": str(options.out) if options.out else None,
        "lerobot": str(options.lerobot) if options.lerobot else None,
        "device": dataset.device, "layout": dataset.layout, "channels": list(dataset.channels),
        "markers": dataset.ids.tolist(),
        "recordings": [
            {"name": r.name, "unit": r.unit, "samples": len(r.sample_time), "frames": len(r.time)}
            for r in dataset.recordings
        ],
        "problems": [
            {"kind": p.kind, "fatal": p.is_fatal, "what": p.message, "remedy": p.action}
            for p in exported.problems
        ],
        "notes": list(exported.notes),
    }  # fmt: skip


def _print_exported(exported: Exported, options: argparse.Namespace) -> None:
    dataset = exported.dataset
    samples = sum(len(r.sample_time) for r in dataset.recordings)
    print_lines([
        f"{dataset.device}: {dataset.frame_count} pictures of {len(dataset.ids)} markers and"
        f" {samples} samples of {len(dataset.channels)} channels, in"
        f" {len(dataset.recordings)} recordings",
    ])  # fmt: skip
    print_lines([f"note: {note}" for note in exported.notes])
    print_lines(
        [f"{'training is not possible' if p.is_fatal else 'note'}: {p}" for p in exported.problems]
    )
    print_lines([f"Wrote:   {folder}" for folder in (options.out, options.lerobot) if folder])
    if options.out is not None:
        device = f" --device {quote(str(options.device))}" if options.device else ""
        print_lines([f"Next:    defsense train {quote(str(options.out))}{device}"])
