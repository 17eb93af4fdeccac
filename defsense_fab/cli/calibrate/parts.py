"""The commands `defsense calibrate specimen | coupon | clearance`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ...core.errors import DeviceError
from ...core.response import CORD_OFFSET_MM
from ...workflow.calibrate.options import (
    CLEARANCES_MM,
    PrintOptions,
    SpecimenOptions,
    TraceOptions,
)
from ..app import command
from ..device import DeviceFolder
from ..output import (
    OutputOptions,
    console,
    print_json,
    print_lines,
    progress_bars,
    standard_output,
)
from .traces import SLICE

if TYPE_CHECKING:
    from ...workflow.calibrate.clearance import Clearance

_SPECIMEN, _PRINTING, _OUTPUT = SpecimenOptions(), PrintOptions(), OutputOptions()
_TRACES = TraceOptions()

specimen = command(
    "specimen",
    "defsense calibrate specimen my-specimen --length 150 --thickness 15 --offset 2",
    "defsense calibrate specimen my-printed-specimen --trace eel",
)
coupon = command("coupon", "defsense calibrate coupon my-coupon --clearances 0.1,0.2,0.3,0.4")
clearance = command(
    "clearance",
    "defsense calibrate clearance my-device --fits 0.3",
    "defsense calibrate clearance my-device --reset",
)


@specimen.default
def _specimen(
    folder: Path,
    /,
    *,
    options: Annotated[SpecimenOptions, Parameter(name="*")] = _SPECIMEN,
    printing: Annotated[PrintOptions, Parameter(name="*")] = _PRINTING,
    traces: Annotated[TraceOptions, Parameter(name="*")] = _TRACES,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Write the bending specimen and its jigs for printing.

    The specimen is a bar with three channels (near the bottom, in the neutral plane, near the top),
    split into two halves for inserting the cords. The rigid jigs with end stops bend it to known
    strains. Print the halves in the device's soft material and the jigs in a rigid one. With
    --trace or --device, the specimen is printed in one piece with conductive traces instead.

    Args:
        folder: Folder for the files.
    """
    from ...workflow.calibrate.calibration_parts import write_specimen
    from ...workflow.calibrate.traced_parts import choose_traces, write_traced_specimen

    chosen = choose_traces(traces, printing)
    with progress_bars(output) as progress:
        if chosen is None:
            data = write_specimen(folder, options, printing, progress).data
        else:
            data = write_traced_specimen(folder, chosen, options, progress).data
    with standard_output():
        if output.json:
            print_json(data)
        else:
            _print_specimen(data, folder)


def _print_specimen(data: dict[str, Any], folder: Path) -> None:
    from rich.table import Table

    is_printed = "traces" in data
    table = Table(title=f"Strain of the {'traces' if is_printed else 'cords'} (%)")
    for column in ("jig", "neutral radius (mm)", *data["channels"]):
        table.add_column(column, justify="left" if column == "jig" else "right")
    for jig in data["jigs"]:
        radius = "-" if jig["radius"] is None else f"{jig['neutral_radius']:g}"
        table.add_row(jig["name"], radius, *(f"{100 * e + 0:.2f}" for e in jig["strains"]))
    console().print(table)
    lines = [f"warning: {warning}" for warning in data["warnings"]]
    if data["offset"] != CORD_OFFSET_MM:
        lines.append(
            f"note: the outer {'traces' if is_printed else 'cords'} are {data['offset']:g} mm from"
            " bottom and top. For tables, run 'defsense calibrate fit' with --offset"
            f" {data['offset']:g}."
        )
    lines += [f"Look at: {folder}"]
    if is_printed:
        ohm = data["traces"][0]["resistance"]
        lines += [
            f"Next:    slice the specimen: {SLICE.format(folder=folder)}; print the jigs in a rigid"
            f" material; connect both pads of each trace, on the end faces: about {ohm:.0f} ohm"
        ]
    else:
        lines += [
            "Next:    print the halves in the device's material and the jigs in a rigid one; glue"
            " the cords into their grooves along the whole length, and then the halves together"
        ]
    print_lines(lines)


@coupon.default
def _coupon(
    folder: Path,
    /,
    *,
    clearances: tuple[float, ...] = CLEARANCES_MM,
    printing: Annotated[PrintOptions, Parameter(name="*")] = _PRINTING,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Write the fit coupon, which determines your printer's clearance.

    It is a plate with half a groove for the cord and a socket for each of several clearances, and a
    peg. Print the plate twice and the peg once, with the process of the device.

    Args:
        folder: Folder for the files.
        clearances: Set the clearances on the diameter in mm.
    """
    from ...workflow.calibrate.calibration_parts import write_coupon

    data = write_coupon(folder, clearances, printing).data
    lines = [
        f"Look at: {folder}",
        "Next:    print the plate twice and the peg once; close the plates over a piece of cord and"
        " find the smallest number at which it slides and the peg fits by hand; then defsense"
        " calibrate clearance DIR --fits NUMBER",
    ]
    with standard_output():
        if output.json:
            print_json(data)
        else:
            print_lines(lines)


@clearance.default
def _clearance(
    folder: DeviceFolder,
    /,
    *,
    fits: float | None = None,
    reset: bool = False,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Write the clearance result with the coupon to a device.

    [fabrication] clearance in device.toml is set, or removed to use the process's clearance again.
    Comments and order are kept.

    Args:
        folder: Folder that contains device.toml.
        fits: Set the smallest number on the coupon at which the cord slides and the peg fits.
        reset: Remove the clearance to use the process's again.
    """
    from ...workflow.calibrate.clearance import write_clearance

    if reset == (fits is not None):
        raise DeviceError(
            "give either --fits or --reset",
            code="options-exclusive" if reset else "argument-missing",
            action="See defsense calibrate clearance --help",
        )
    result = write_clearance(folder, fits)
    with standard_output():
        if output.json:
            data = {
                "file": str(result.file),
                "process": result.fabrication.process,
                "was": result.was,
                "written_before": result.written,
                "clearance": result.fabrication.clearance,
            }
            print_json(data)
        else:
            print_lines(_describe_clearance(result, folder))


def _describe_clearance(result: Clearance, folder: Path) -> list[str]:
    now, process = result.fabrication.clearance, result.fabrication.process
    before = "from the process" if result.written is None else "set"
    after = f"from process {process}" if result.now is None else "set"
    undo = "--reset" if result.written is None else f"--fits {result.written:g}"
    return [
        *([f"note: {result.note}"] if result.note else []),
        f"{result.file}: [fabrication] clearance is {now:g} mm ({after}); it was {result.was:g} mm"
        f" ({before})",
        f"Undo:    defsense calibrate clearance {folder} {undo}",
        f"Next:    defsense build {folder}, which updates channels and sockets",
    ]
