"""The command `defsense dataset`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ...core.errors import TrainingError
from ..options import within
from ..output import progress_bars, results, say
from .data_arguments import data_arguments, data_given

if TYPE_CHECKING:
    from ...training.models.prepare import Exported
    from ..options import Commands


def add(commands: Commands) -> None:
    """`dataset`."""
    sub = commands.add_parser(
        "dataset",
        help="sessions and files of others as a dataset: Parquet, or LeRobot's format",
        description="Write what training would be given into a folder of its own: all samples of"
        " the read-out board and all places of markers, with units, R0, clocks, poses and where"
        " they are from. Train, evaluate and dataset take the folder in place of the sessions."
        " What is wrong with the data is told; nothing of it is left out.",
        examples=[
            "defsense dataset my-device/session --device my-device --out my-device/data",
            "defsense dataset --signals signals.csv --tracks take.c3d --offset auto --out data",
            "defsense dataset my-device/session --lerobot policy-data --rate 30",
        ],
    )
    data_arguments(sub)
    sub.add_argument("--out", type=Path, metavar="DIR",
                     help="where to write Parquet, over a dataset that is there")  # fmt: skip
    sub.add_argument("--lerobot", type=Path, metavar="DIR",
                     help="where to write LeRobot's format 2.1; not there yet")  # fmt: skip
    sub.add_argument("--rate", type=int, metavar="HZ",
                     help="of LeRobot's frames (that of the pictures)")  # fmt: skip
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=_dataset)


def _dataset(options: argparse.Namespace) -> int:
    files = data_given(options)
    if files is None:
        raise TrainingError("nothing to write: give sessions, or --signals with --tracks")
    if options.out is None and options.lerobot is None:
        raise TrainingError("nowhere to write: give --out FOLDER, --lerobot FOLDER, or both")
    if options.rate is not None:
        if options.lerobot is None:
            raise TrainingError("--rate is of --lerobot alone: Parquet has the times as they are")
        within("--rate", options.rate, 1, 1000)
    from ...core.device.device_file import load_device
    from ...training.models.prepare import export_dataset

    device = load_device(options.device) if options.device else None
    with progress_bars(options) as progress:
        found = export_dataset(
            files, device, parquet=options.out, lerobot=options.lerobot, rate=options.rate,
            progress=progress,
        )  # fmt: skip
    with results():
        if options.json:
            sys.stdout.write(json.dumps(_told(found, options), indent=1, allow_nan=False) + "\n")
        else:
            _show(found, options)
    return 0


def _told(found: Exported, options: argparse.Namespace) -> dict[str, object]:
    d = found.dataset
    return {
        "parquet": str(options.out) if options.out else None,
        "lerobot": str(options.lerobot) if options.lerobot else None,
        "device": d.device, "layout": d.layout, "channels": list(d.channels),
        "markers": d.ids.tolist(),
        "recordings": [
            {"name": r.name, "unit": r.unit, "samples": len(r.sample_time), "frames": len(r.time)}
            for r in d.recordings
        ],
        "problems": [
            {"kind": p.kind, "fatal": p.is_fatal, "what": p.message, "remedy": p.action}
            for p in found.problems
        ],
        "notes": list(found.notes),
    }  # fmt: skip


def _show(found: Exported, options: argparse.Namespace) -> None:
    d = found.dataset
    samples = sum(len(r.sample_time) for r in d.recordings)
    say([
        f"{d.device}: {d.frame_count} pictures of {len(d.ids)} markers and {samples} samples of"
        f" {len(d.channels)} channels, in {len(d.recordings)} recordings",
    ])  # fmt: skip
    say([f"note: {note}" for note in found.notes])
    say([f"{'training is refused' if p.is_fatal else 'note'}: {p}" for p in found.problems])
    say([f"Wrote:   {folder}" for folder in (options.out, options.lerobot) if folder])
    if options.out is not None:
        device = f" --device {quote(str(options.device))}" if options.device else ""
        say([f"Next:    defsense train {quote(str(options.out))}{device}"])
