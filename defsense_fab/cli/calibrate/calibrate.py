"""The commands `defsense calibrate ...`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import DeviceError
from ..options import numbers
from ..output import progress_bars, say
from . import calibrate_record

if TYPE_CHECKING:
    from ..options import Bars, Commands


def add(commands: Commands) -> None:
    """Add the commands."""
    bars = progress_bars
    parent = commands.add_parser(
        "calibrate",
        help="how the cord answers to strain: specimen, measurement, fit",
        description="Find out how the cord answers to strain.",
    )
    steps = parent.add_subparsers(dest="step", required=True, metavar="STEP")
    sub = steps.add_parser(
        "specimen",
        help="write the bending specimen and its jigs for printing",
        description="Write a bar with three channels (near the bottom, in the neutral plane, near"
        " the top), split in two halves for the cords, and rigid jigs with end stops, on which it"
        " is bent to known strains. Print the halves in the device's soft material, the jigs in a"
        " rigid one.",
        examples=["defsense calibrate specimen my-specimen --length 150 --thickness 15 --offset 2"],
    )
    sub.add_argument("folder", type=Path, metavar="OUT", help="the folder to write to")
    for name, default, text in (
        ("length", 150.0, "of the specimen"),
        ("thickness", 15.0, "of the specimen"),
        ("width", 20.0, "of the specimen"),
    ):
        sub.add_argument(
            f"--{name}", type=float, default=default, metavar="MM", help=f"{text} ({default:g})"
        )
    sub.add_argument(
        "--offset", type=float, metavar="MM",
        help="of the outer cords from bottom and top (2, or what leaves two lines of skin)",
    )  # fmt: skip
    sub.add_argument(
        "--radii", metavar="R,R,...", help="of the jigs' surfaces, mm (75,87.5,...,250)"
    )
    _common(sub)
    sub.set_defaults(run=lambda options: _specimen(options, bars))
    sub = steps.add_parser(
        "coupon",
        help="write the fit coupon, which finds your printer's clearance",
        description="Write a plate with half a groove for the cord and a socket for each of several"
        " clearances, and a peg. Print the plate twice and the peg once, as the device will be"
        " printed.",
        examples=["defsense calibrate coupon my-coupon --clearances 0.1,0.2,0.3,0.4"],
    )
    sub.add_argument("folder", type=Path, metavar="OUT", help="the folder to write to")
    sub.add_argument(
        "--clearances", metavar="C,C,...", help="on the diameter, mm (0,0.1,0.2,0.3,0.4,0.5)"
    )
    _common(sub)
    sub.set_defaults(run=_coupon)
    sub = steps.add_parser(
        "clearance",
        help="write the clearance that the coupon showed into a device",
        description="Write [fabrication] clearance into DIR/device.toml, whose comments and order"
        " stay, or remove it, so that the process's counts again.",
        examples=[
            "defsense calibrate clearance my-device --fits 0.25",
            "defsense calibrate clearance my-device --reset",
        ],
    )
    sub.add_argument("folder", type=Path, metavar="DIR", help="the folder of device.toml")
    which = sub.add_mutually_exclusive_group(required=True)
    which.add_argument(
        "--fits", type=float, metavar="MM",
        help="the least number on the coupon at which the cord slides and the peg goes in",
    )  # fmt: skip
    which.add_argument(
        "--reset", action="store_true", help="remove the clearance: the process's counts again"
    )
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=_clearance)
    calibrate_record.add(steps)
    _add_fit(steps, bars)


def _add_fit(steps: Commands, bars: Bars) -> None:
    sub = steps.add_parser(
        "fit",
        help="fit the cord's response to sessions or tables of readings",
        description="Fit w(eps), the relative change of resistance by strain, to recorded"
        " sessions (folders of 'calibrate record') and tables, and write response.json with its"
        " 95 % interval and a report beside it. A table is CSV with the columns specimen,"
        " jig_radius (mm of the jig's surface, empty when flat), channel (top, neutral or bottom,"
        " the bottom lying on the jig), resistance (ohm); optionally round and face.",
        examples=[
            "defsense calibrate fit my-specimen/session-1 my-specimen/session-2",
            "defsense calibrate fit readings.csv --thickness 15 --offset 2 --out response.json",
        ],
    )
    sub.add_argument("sources", type=Path, nargs="+", metavar="SESSION|CSV")
    sub.add_argument(
        "--out", type=Path, default=Path("response.json"), metavar="FILE",
        help="where to write (response.json); the report goes beside it, as .html",
    )  # fmt: skip
    sub.add_argument("--thickness", type=float, default=15.0, metavar="MM",
                     help="of the specimens in tables (15)")  # fmt: skip
    sub.add_argument("--offset", type=float, default=2.0, metavar="MM",
                     help="of the outer cords from bottom and top, in tables (2)")  # fmt: skip
    sub.add_argument(
        "--radii", metavar="R,R,...", help="of the jigs that tables may name, mm (75,87.5,...,250)"
    )
    sub.add_argument(
        "--neutral", choices=("refuse", "correct", "ignore"), default="refuse",
        help="what to do when the neutral cord drifts: refuse (default), take its change from the"
        " others, or ignore it",
    )  # fmt: skip
    sub.add_argument(
        "--model", choices=("line", "two-slopes", "quadratic", "cubic", "piecewise"),
        help="in place of the one that the readings call for",
    )  # fmt: skip
    sub.add_argument(
        "--spread", type=float, default=3.0, metavar="PERCENT",
        help="standard deviation between specimens taken for granted while they are few (3)",
    )  # fmt: skip
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=lambda options: _fit(options, bars))


def _fit(options: argparse.Namespace, bars: Bars) -> int:
    from ...calibration.readings import Geometry
    from ...workflow.calibrate.fit_response import fit_response

    if not 0 <= options.spread <= 50:
        raise DeviceError(f"--spread {options.spread:g}: give per cent, from 0 to 50")
    with bars(options) as progress:
        found = fit_response(
            options.sources,
            out=options.out,
            geometry=Geometry(options.thickness, options.offset),
            radii=numbers("--radii", options.radii) if options.radii else None,
            policy=options.neutral,
            model=options.model,
            spread=options.spread / 100,
            progress=progress,
        )
    if options.json:
        sys.stdout.write(json.dumps(found.data, indent=1) + "\n")
        return 0
    from rich.console import Console

    d = found.data
    low, high = d["interval"]
    neutral = "none" if d["neutral_drift"] is None else f"{d['neutral_drift']:+.2%}"
    lines = [
        f"k_res = {d['k_res']:.2f}  (95 %: {low:.2f} to {high:.2f})",
        d["reason"],
        f"strains {d['strain_range'][0]:.1%} to {d['strain_range'][1]:.1%}, {d['readings']}"
        f" readings of {len(d['pieces'])} pieces; neutral cord {neutral}",
        *(f"note: {w}" for w in d["warnings"]),
        f"Look at: {options.out.with_suffix('.html')}",
        f"Next:    copy {options.out} into the device's folder and write [cord] response ="
        f' "{options.out.name}" into its device.toml',
    ]
    console = Console()
    for line in lines:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    return 0


def _common(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--cord",
        default="rubber-2mm",
        metavar="NAME",
        help="of data/cords.csv, or the diameter of another, mm (rubber-2mm)",
    )
    sub.add_argument(
        "--process", default="fdm-tpu", metavar="NAME", help="of data/printers.csv (fdm-tpu)"
    )
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")


def _specimen(options: argparse.Namespace, bars: Bars) -> int:
    from ...core.response import JIG_RADII_MM
    from ...workflow.calibrate.specimen_files import write_specimen

    with bars(options) as progress:
        found = write_specimen(
            options.folder,
            length=options.length,
            thickness=options.thickness,
            width=options.width,
            offset=options.offset,
            radii=numbers("--radii", options.radii) if options.radii else JIG_RADII_MM,
            cord=options.cord,
            process=options.process,
            progress=progress,
        )
    if options.json:
        sys.stdout.write(json.dumps(found.data, indent=1) + "\n")
    else:
        _show(found.data, options)
    return 0


def _coupon(options: argparse.Namespace) -> int:
    from ...workflow.calibrate.coupon_files import CLEARANCES, write_coupon

    asked = options.clearances
    found = write_coupon(
        options.folder,
        clearances=numbers("--clearances", asked) if asked else CLEARANCES,
        cord=options.cord,
        process=options.process,
    )
    if options.json:
        sys.stdout.write(json.dumps(found.data, indent=1) + "\n")
    else:
        sys.stdout.write(
            f"Look at: {options.folder}\n"
            "Next:    print the plate twice and the peg once; close the plates over a piece of cord"
            " and find the least number at which it slides and the peg goes in by hand; then:"
            " defsense calibrate clearance DIR --fits NUMBER\n"
        )
    return 0


def _clearance(options: argparse.Namespace) -> int:
    from ...calibration.clearance import write_clearance
    from ...workflow.calibrate.coupon_files import NO_MOULD

    found = write_clearance(options.folder, options.fits)
    now, process = found.fabrication.clearance, found.fabrication.process
    undo = "--reset" if found.written is None else f"--fits {found.written:g}"
    if options.json:
        data = {
            "file": str(found.file), "process": process, "was": found.was,
            "written_before": found.written, "clearance": now,
        }  # fmt: skip
        sys.stdout.write(json.dumps(data, indent=1) + "\n")
        return 0
    before = "of the process" if found.written is None else "as written"
    after = f"of process {process}" if found.now is None else "written"
    if found.fabrication.kind == "cast" and found.now is not None:
        say([f"note: {process} {NO_MOULD}"])
    sys.stdout.write(
        f"{found.file}: [fabrication] clearance is {now:g} mm ({after}); it was {found.was:g} mm"
        f" ({before})\n"
        f"Undo:    defsense calibrate clearance {options.folder} {undo}\n"
        f"Next:    defsense build {options.folder}, which makes channels and sockets anew\n"
    )
    return 0


def _show(data: dict[str, Any], options: argparse.Namespace) -> None:
    from rich.console import Console
    from rich.table import Table

    from ...workflow.calibrate.specimen_files import OFFSET

    console = Console()
    table = Table(title="strain of the cords, %")
    for column in ("jig", "neutral radius, mm", *data["channels"]):
        table.add_column(column, justify="left" if column == "jig" else "right")
    for jig in data["jigs"]:
        radius = "-" if jig["radius"] is None else f"{jig['neutral_radius']:g}"
        table.add_row(jig["name"], radius, *(f"{100 * e + 0:.2f}" for e in jig["strains"]))
    console.print(table)
    for warning in data["warnings"]:
        console.print(f"warning: {warning}", highlight=False, markup=False, soft_wrap=True)
    if data["offset"] != OFFSET:
        console.print(
            f"note: the outer cords lie {data['offset']:g} mm from bottom and top: give 'defsense"
            f" calibrate fit' of a table of your own --offset {data['offset']:g}",
            highlight=False, markup=False, soft_wrap=True,
        )  # fmt: skip
    console.print(
        f"Look at: {options.folder}\nNext:    print the halves in the device's material and the"
        " jigs in a rigid one; glue the cords into their grooves all along, and the halves",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
