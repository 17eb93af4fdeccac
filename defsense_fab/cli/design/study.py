"""Command `defsense study`: vary the number of cords, or the parameters of study.toml."""

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
    """Add `study`."""
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
                f"{options.sensors} conflicts with {options.folder / FILE}",
                code="options-conflict",
                where="--sensors",
                action="Set design.sensors there, or move that file away",
                option="--sensors",
            )
        from .parameter_study import run_parameter_study

        return run_parameter_study(options)
    for name in ("workers", "scheduler"):
        if getattr(options, name) is not None:
            raise DeviceError(
                f"applies to the runs of {options.folder / FILE}, which does not exist",
                code="study-file-missing",
                where=f"--{name}",
                action="Create the file (docs/study.md), or omit the option",
                option=f"--{name}",
            )
    return _count_cords(options)


def _count_cords(options: argparse.Namespace) -> int:
    from ...core.device.device_file import load_device

    low, high = _parse_range(options.sensors or "1..6")
    device = load_device(options.folder, parse_overrides(options.set))
    from ...workflow.study import cord_count

    with silent_stdout(), progress_bars(options) as progress:
        result = cord_count.study_cord_count(device, low, high, progress)
    with standard_output():
        if options.json:
            rows = [{k: v for k, v in vars(r).items() if k != "layout"} for r in result.rows]
            data = {"rows": rows, "knee": result.knee, "decoder": result.decoder, "how": result.how}
            data["ended"] = result.ended
            files = {"file": str(result.file), "picture": str(result.picture)}
            print_json({**data, **files})
        else:
            _print_study(result, options)
    return 0


def _parse_range(text: str) -> tuple[int, int]:
    low, dots, high = text.partition("..")
    if not (low.isdecimal() and (high.isdecimal() if dots else not high)):
        raise DeviceError(
            f"{text} is not a range",
            code="range-invalid",
            where="--sensors",
            action="Give a range such as 1..6, or one number",
            value=text,
        )
    first, last = int(low), int(high or low)
    if not 1 <= first <= last <= 16:
        raise DeviceError(
            f"{text} is out of range",
            code="out-of-range",
            where="--sensors",
            action="Give numbers from 1 to 16, the smaller one first",
            value=text,
        )
    return first, last


def _print_study(result: Study, options: argparse.Namespace) -> None:
    from rich.table import Table

    from ...decoding.expected_errors import MEANING

    out = console()
    table = Table(title="Predicted RMSE (mm) by number of cords")
    for column in ("cords", "unseen", "fitted", "without noise", "affine limit", "decoder", ""):
        table.add_column(column, justify="left" if column in ("decoder", "") else "right")
    for r in result.rows:
        numbers = (r.unseen, r.rmse, r.rmse_noise_free, r.floor)
        cells = (f"{v:.3f}" for v in numbers)
        mark = "recommended" if r.sensors == result.knee else ""
        table.add_row(str(r.sensors), *cells, r.decoder, mark)
    out.print(table)
    if result.ended:
        print_lines([f"note: the study ended early: {result.ended}"])
    print_lines([f"note: {MEANING[result.how]}"])
    print_lines([
        f"Look at: {result.picture}",
        f"Next:    set [design] sensors = {result.knee} in"
        f" {options.folder / 'device.toml'}, then run defsense build {options.folder}",
    ])  # fmt: skip
