"""The command `defsense study`."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from ...core.errors import DeviceError
from ..device import device_arguments, overrides
from ..output import console, progress_bars, results, say, silent_stdout

if TYPE_CHECKING:
    from ...workflow.study.cord_count import Study
    from ..options import Commands


def add(commands: Commands) -> None:
    """`study`."""
    sub = commands.add_parser(
        "study",
        help="how many cords a device should have, or any parameters by study.toml",
        description="Without a study.toml beside device.toml: find the best layout of each number"
        " of cords and show how the predicted error falls. Cords drawn in device.toml are left out"
        " of account; [design] planes holds; with the decoder auto each number has the one that"
        " does best. With one: make all its runs, on this machine or on a cluster, and show which"
        " parameters matter (docs/study.md). A study that was interrupted goes on where it stood.",
        examples=[
            "defsense study fixtures/devices/bar --sensors 1..6",
            "defsense study my-device --workers 4",
            "defsense study my-device --scheduler tcp://192.168.1.10:8786",
        ],
    )
    device_arguments(sub)
    sub.add_argument("--sensors", metavar="A..B", help="numbers of cords to look at (1..6)")
    sub.add_argument(
        "--workers", type=int, metavar="N",
        help="processes of this machine for the runs of study.toml (its cores)",
    )  # fmt: skip
    sub.add_argument(
        "--scheduler", metavar="ADDRESS", help="of a Dask cluster that makes the runs of study.toml"
    )
    sub.set_defaults(run=_study)


def _study(options: argparse.Namespace) -> int:
    from ...workflow.study.points.study_toml import FILE, is_there

    if is_there(options.folder):
        if options.sensors is not None:
            raise DeviceError(
                f"--sensors {options.sensors}: {options.folder / FILE} says what is studied; give"
                " design.sensors there, or move that file away"
            )
        from .parameter_study import run_parameter_study

        return run_parameter_study(options)
    for name in ("workers", "scheduler"):
        if getattr(options, name) is not None:
            raise DeviceError(
                f"--{name}: is for the runs of {options.folder / FILE}, which is not there;"
                " docs/study.md tells how to write one"
            )
    return _count_cords(options)


def _count_cords(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device

    least, most = _range(options.sensors or "1..6")
    device = load_device(options.folder, overrides(options.set))
    from ...workflow.study import cord_count

    with silent_stdout(), progress_bars(options) as progress:
        found = cord_count.study(device, least, most, progress)
    with results():
        if options.json:
            rows = [{k: v for k, v in vars(r).items() if k != "layout"} for r in found.rows]
            data = {"rows": rows, "knee": found.knee, "decoder": found.decoder, "how": found.how}
            data["ended"] = found.ended
            files = {"file": str(found.file), "picture": str(found.picture)}
            sys.stdout.write(json.dumps({**data, **files}, indent=1) + "\n")
        else:
            _show_study(found, options)
    return 0


def _range(text: str) -> tuple[int, int]:
    least, dots, most = text.partition("..")
    if not (least.isdecimal() and (most.isdecimal() if dots else not most)):
        raise DeviceError(f"--sensors {text}: write a range such as 1..6, or one number")
    a, b = int(least), int(most or least)
    if not 1 <= a <= b <= 16:
        raise DeviceError(f"--sensors {text}: give numbers from 1 to 16, the smaller one first")
    return a, b


def _show_study(found: Study, options: argparse.Namespace) -> None:
    from rich.table import Table

    from ...decoding.expected_errors import MEANING

    out = console()
    table = Table(title="predicted RMSE, mm, by number of cords")
    for column in ("cords", "unseen", "fitted", "no noise", "affine floor", "decoder", ""):
        table.add_column(column, justify="left" if column in ("decoder", "") else "right")
    for r in found.rows:
        numbers = (r.unseen, r.rmse, r.rmse_noise_free, r.floor)
        cells = (f"{v:.3f}" for v in numbers)
        mark = "recommended" if r.sensors == found.knee else ""
        table.add_row(str(r.sensors), *cells, r.decoder, mark)
    out.print(table)
    if found.ended:
        say([f"note: ended early: {found.ended}"])
    say([f"note: {MEANING[found.how]}"])
    say([
        f"Look at: {found.picture}",
        f"Next:    [design] sensors = {found.knee} in {options.folder / 'device.toml'}, then"
        f" defsense build {options.folder}",
    ])  # fmt: skip
