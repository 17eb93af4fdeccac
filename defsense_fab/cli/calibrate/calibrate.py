"""Commands `defsense calibrate ...`: specimen, coupon, clearance, fit."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import DeviceError
from ..options import add_output_options, parse_numbers
from ..output import console, print_json, print_lines, progress_bars
from . import calibrate_record

if TYPE_CHECKING:
    from ..options import Bars, Commands


def add(commands: Commands) -> None:
    """Add `calibrate` and its steps."""
    bars = progress_bars
    parent = commands.add_parser(
        "calibrate",
        help="Measure how the cord responds to strain: specimen, measurement, fit",
        description="Measure how the cord responds to strain.",
    )
    steps = parent.add_subparsers(dest="step", required=True, metavar="STEP")
    sub = steps.add_parser(
        "specimen",
        help="Write the bending specimen and its jigs for printing",
        description="Write a bar with three channels (near the bottom, in the neutral plane, near "
        "the top), split into two halves for inserting the cords, and rigid jigs with "
        "end stops, which bend it to known strains. Print the halves in the device's "
        "soft material and the jigs in a rigid one.",
        examples=["defsense calibrate specimen my-specimen --length 150 --thickness 15 --offset 2"],
    )
    sub.add_argument("folder", type=Path, metavar="OUT", help="Output folder")
    for name, default, text in (
        ("length", 150.0, "length of the specimen"),
        ("thickness", 15.0, "thickness of the specimen"),
        ("width", 20.0, "width of the specimen"),
    ):
        sub.add_argument(
            f"--{name}",
            type=float,
            default=default,
            metavar="MM",
            help=f"Set the {text} in mm (default: {default:g})",
        )
    sub.add_argument(
        "--offset",
        type=float,
        metavar="MM",
        help="Set the distance of the outer cords from bottom and top in mm (default: 2, or"
        " what leaves two lines of skin)",
    )
    sub.add_argument(
        "--radii",
        metavar="R,R,...",
        help="Set the radii of the jigs' surfaces in mm (default: 75,87.5,...,250)",
    )
    _add_common_options(sub)
    sub.set_defaults(run=lambda options: _specimen(options, bars))
    sub = steps.add_parser(
        "coupon",
        help="Write the fit coupon, which determines your printer's clearance",
        description="Write a plate with half a groove for the cord and a socket for each of "
        "several clearances, and a peg. Print the plate twice and the peg once, with "
        "the process of the device.",
        examples=["defsense calibrate coupon my-coupon --clearances 0.1,0.2,0.3,0.4"],
    )
    sub.add_argument("folder", type=Path, metavar="OUT", help="Output folder")
    sub.add_argument(
        "--clearances",
        metavar="C,C,...",
        help="Set the clearances on the diameter in mm (default: 0,0.1,0.2,0.3,0.4,0.5)",
    )
    _add_common_options(sub)
    sub.set_defaults(run=_coupon)
    sub = steps.add_parser(
        "clearance",
        help="Write the clearance result with the coupon to a device",
        description="Write [fabrication] clearance to DIR/device.toml, keeping its comments and "
        "order, or remove it to use the process's clearance again.",
        examples=[
            "defsense calibrate clearance my-device --fits 0.25",
            "defsense calibrate clearance my-device --reset",
        ],
    )
    sub.add_argument("folder", type=Path, metavar="DIR", help="Folder that contains device.toml")
    which = sub.add_mutually_exclusive_group(required=True)
    which.add_argument(
        "--fits",
        type=float,
        metavar="MM",
        help="Set the smallest number on the coupon at which the cord slides and the peg fits",
    )
    which.add_argument(
        "--reset", action="store_true", help="Remove the clearance to use the process's again"
    )
    add_output_options(sub)
    sub.set_defaults(run=_clearance)
    calibrate_record.add(steps)
    _add_fit(steps, bars)


def _add_fit(steps: Commands, bars: Bars) -> None:
    sub = steps.add_parser(
        "fit",
        help="Fit the cord's response to sessions or tables of readings",
        description="Fit w(eps), the relative change of resistance as a function of strain, to "
        "recorded sessions (folders of 'calibrate record') and tables. Write "
        "response.json with its 95 % interval, and a report next to it. A table is a "
        "CSV file with the columns specimen, jig_radius (mm of the jig's surface, "
        "empty when flat), channel (top, neutral or bottom; the bottom lies on the "
        "jig), resistance (ohm); optionally round and face.",
        examples=[
            "defsense calibrate fit my-specimen/session-1 my-specimen/session-2",
            "defsense calibrate fit readings.csv --thickness 15 --offset 2 --out response.json",
        ],
    )
    sub.add_argument(
        "sources",
        type=Path,
        nargs="+",
        metavar="SESSION|CSV",
        help="Sessions or tables of readings",
    )
    sub.add_argument(
        "--out",
        type=Path,
        default=Path("response.json"),
        metavar="FILE",
        help="Set the output file; the report has the same name with .html (default: "
        "response.json)",
    )
    sub.add_argument(
        "--thickness",
        type=float,
        default=15.0,
        metavar="MM",
        help="Set the thickness of the specimens in mm, for tables (default: 15)",
    )
    sub.add_argument(
        "--offset",
        type=float,
        default=2.0,
        metavar="MM",
        help="Set the distance of the outer cords from bottom and top in mm, for tables "
        "(default: 2)",
    )
    sub.add_argument(
        "--radii",
        metavar="R,R,...",
        help="Set the radii in mm of the jigs that tables may name (default: 75,87.5,...,250)",
    )
    sub.add_argument(
        "--neutral",
        choices=("refuse", "correct", "ignore"),
        default="refuse",
        help="Choose what to do when the neutral cord drifts: refuse (default), correct by "
        "subtracting its change from the others, or ignore",
    )
    sub.add_argument(
        "--model",
        choices=("line", "two-slopes", "quadratic", "cubic", "piecewise"),
        help="Choose the model of the response (default: the one that the readings support)",
    )
    sub.add_argument(
        "--spread",
        type=float,
        default=3.0,
        metavar="PERCENT",
        help="Set the standard deviation between specimens, in percent, assumed while they "
        "are few (default: 3)",
    )
    add_output_options(sub)
    sub.set_defaults(run=lambda options: _fit(options, bars))


def _fit(options: argparse.Namespace, bars: Bars) -> int:
    from ...calibration.readings import Geometry
    from ...workflow.calibrate.fit_response import fit_response

    if not 0 <= options.spread <= 50:
        raise DeviceError(
            f"{options.spread:g} is out of range",
            code="out-of-range",
            where="--spread",
            action="Give percent, from 0 to 50",
            value=options.spread,
        )
    with bars(options) as progress:
        result = fit_response(
            options.sources,
            out=options.out,
            geometry=Geometry(options.thickness, options.offset),
            radii=parse_numbers("--radii", options.radii) if options.radii else None,
            policy=options.neutral,
            model=options.model,
            spread=options.spread / 100,
            progress=progress,
        )
    if options.json:
        print_json(result.data)
        return 0
    d = result.data
    low, high = d["interval"]
    neutral_drift = "none" if d["neutral_drift"] is None else f"{d['neutral_drift']:+.2%}"
    lines = [
        f"k_res = {d['k_res']:.2f}  (95 %: {low:.2f} to {high:.2f})",
        d["reason"],
        f"strains {d['strain_range'][0]:.1%} to {d['strain_range'][1]:.1%}, {d['readings']}"
        f" readings of {len(d['pieces'])} pieces; drift of the neutral cord: {neutral_drift}",
        *(f"note: {w}" for w in d["warnings"]),
        f"Look at: {options.out.with_suffix('.html')}",
        f"Next:    copy {options.out} to the device folder and set [cord] response ="
        f' "{options.out.name}" in its device.toml',
    ]
    print_lines(lines)
    return 0


def _add_common_options(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--cord",
        default="rubber-2mm",
        metavar="NAME",
        help="Set the cord: a row of data/cords.csv, or the diameter of another cord in mm "
        "(default: rubber-2mm)",
    )
    sub.add_argument(
        "--process",
        default="fdm-tpu",
        metavar="NAME",
        help="Set the process, a row of data/printers.csv (default: fdm-tpu)",
    )
    add_output_options(sub)


def _specimen(options: argparse.Namespace, bars: Bars) -> int:
    from ...core.response import JIG_RADII_MM
    from ...workflow.calibrate.calibration_parts import write_specimen

    with bars(options) as progress:
        result = write_specimen(
            options.folder,
            length=options.length,
            thickness=options.thickness,
            width=options.width,
            offset=options.offset,
            radii=parse_numbers("--radii", options.radii) if options.radii else JIG_RADII_MM,
            cord=options.cord,
            process=options.process,
            progress=progress,
        )
    if options.json:
        print_json(result.data)
    else:
        _print_specimen(result.data, options)
    return 0


def _coupon(options: argparse.Namespace) -> int:
    from ...workflow.calibrate.calibration_parts import CLEARANCES, write_coupon

    clearances = options.clearances
    result = write_coupon(
        options.folder,
        clearances=parse_numbers("--clearances", clearances) if clearances else CLEARANCES,
        cord=options.cord,
        process=options.process,
    )
    if options.json:
        print_json(result.data)
    else:
        sys.stdout.write(
            f"Look at: {options.folder}\n"
            "Next:    print the plate twice and the peg once; close the plates over a piece of cord"
            " and find the smallest number at which it slides and the peg fits by hand; then"
            " defsense calibrate clearance DIR --fits NUMBER\n"
        )
    return 0


def _clearance(options: argparse.Namespace) -> int:
    from ...calibration.clearance import write_clearance
    from ...workflow.calibrate.calibration_parts import NO_MOULD

    result = write_clearance(options.folder, options.fits)
    now, process = result.fabrication.clearance, result.fabrication.process
    undo = "--reset" if result.written is None else f"--fits {result.written:g}"
    if options.json:
        data = {
            "file": str(result.file), "process": process, "was": result.was,
            "written_before": result.written, "clearance": now,
        }  # fmt: skip
        print_json(data)
        return 0
    before = "from the process" if result.written is None else "set"
    after = f"from process {process}" if result.now is None else "set"
    if result.fabrication.kind == "cast" and result.now is not None:
        print_lines([f"note: {process} {NO_MOULD}"])
    sys.stdout.write(
        f"{result.file}: [fabrication] clearance is {now:g} mm ({after}); it was {result.was:g} mm"
        f" ({before})\n"
        f"Undo:    defsense calibrate clearance {options.folder} {undo}\n"
        f"Next:    defsense build {options.folder}, which updates channels and sockets\n"
    )
    return 0


def _print_specimen(data: dict[str, Any], options: argparse.Namespace) -> None:
    from rich.table import Table

    from ...workflow.calibrate.calibration_parts import OFFSET

    table = Table(title="Strain of the cords (%)")
    for column in ("jig", "neutral radius (mm)", *data["channels"]):
        table.add_column(column, justify="left" if column == "jig" else "right")
    for jig in data["jigs"]:
        radius = "-" if jig["radius"] is None else f"{jig['neutral_radius']:g}"
        table.add_row(jig["name"], radius, *(f"{100 * e + 0:.2f}" for e in jig["strains"]))
    console().print(table)
    print_lines(f"warning: {warning}" for warning in data["warnings"])
    if data["offset"] != OFFSET:
        print_lines([
            f"note: the outer cords are {data['offset']:g} mm from bottom and top. For tables, run"
            f" 'defsense calibrate fit' with --offset {data['offset']:g}."
        ])  # fmt: skip
    print_lines([
        f"Look at: {options.folder}",
        "Next:    print the halves in the device's material and the jigs in a rigid one; glue the"
        " cords into their grooves along the whole length, and then the halves together",
    ])  # fmt: skip
