"""The command `defsense study`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ...core.errors import DeviceError
from ..device import add_device_arguments, parse_overrides
from ..output import console, print_json, print_lines, progress_bars, silent_stdout, standard_output

if TYPE_CHECKING:
    from ...workflow.study.cord_count import Study
    from ..options import Commands


def add(commands: Commands) -> None:
    """`study`."""
    sub = commands.add_parser(
        "study",
        help="Find how many cords a device needs, or vary parameters by study.toml",
        description="Without a study.toml next to device.toml: find the best layout for each "
        "number of cords and show how the predicted error decreases. Cords drawn in "
        "device.toml are ignored; [design] planes applies; with the decoder auto, each"
        " number of cords has its best decoder. With a study.toml: run all its points,"
        " on this machine or on a cluster, and show which parameters matter "
        "(docs/study.md). Rerun the command to resume an interrupted study.",
        examples=[
            "defsense study fixtures/devices/bar --sensors 1..6",
            "defsense study my-device --workers 4",
            "defsense study my-device --scheduler tcp://192.168.1.10:8786",
        ],
    )
    add_device_arguments(sub)
    sub.add_argument(
        "--sensors", metavar="A..B", help="Set the numbers of cords to try (default: 1..6)"
    )
    sub.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="Set the number of local processes for the runs of study.toml (default: number"
        " of cores)",
    )
    sub.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="Run study.toml on a Dask cluster with this scheduler address",
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
    device = load_device(options.folder, parse_overrides(options.set))
    from ...workflow.study import cord_count

    with silent_stdout(), progress_bars(options) as progress:
        found = cord_count.study_cord_count(device, least, most, progress)
    with standard_output():
        if options.json:
            rows = [{k: v for k, v in vars(r).items() if k != "layout"} for r in found.rows]
            data = {"rows": rows, "knee": found.knee, "decoder": found.decoder, "how": found.how}
            data["ended"] = found.ended
            files = {"file": str(found.file), "picture": str(found.picture)}
            print_json({**data, **files})
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
        print_lines([f"note: ended early: {found.ended}"])
    print_lines([f"note: {MEANING[found.how]}"])
    print_lines([
        f"Look at: {found.picture}",
        f"Next:    [design] sensors = {found.knee} in {options.folder / 'device.toml'}, then"
        f" defsense build {options.folder}",
    ])  # fmt: skip
