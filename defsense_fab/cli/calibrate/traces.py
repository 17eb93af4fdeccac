"""The commands `defsense calibrate trace-coupon | resistivity`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ...core.errors import FabricationError
from ...workflow.calibrate.options import PrintOptions, ResistivityOptions, TraceOptions
from ..app import command
from ..output import OutputOptions, console, print_json, print_lines, standard_output

if TYPE_CHECKING:
    from ...workflow.calibrate.fit_resistivity import MeasuredCoupon

_TRACES, _RESISTIVITY, _OUTPUT = TraceOptions(), ResistivityOptions(), OutputOptions()
SLICE = (
    "prusa-slicer --load two-extruders.ini --export-gcode --dont-arrange --output FILE.gcode"
    " prusaslicer.3mf, and check it: defsense traces {folder} FILE.gcode"
)

trace_coupon = command("trace-coupon", "defsense calibrate trace-coupon my-traces --trace eel")
resistivity = command(
    "resistivity",
    "defsense calibrate resistivity my-traces --ohm 7710,2600,3870,1550,1600,4930,3310",
    "defsense calibrate resistivity my-traces --readings readings.csv",
)


@trace_coupon.default
def _coupon(
    folder: Path,
    /,
    *,
    traces: Annotated[TraceOptions, Parameter(name="*")] = _TRACES,
    process: str = PrintOptions.process,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Write the coupon of printed traces, which determines a filament's resistivity.

    It is a block with numbered rows and a trace in each: level ones of several lengths, a wide one,
    and two that rise. coupon.json has the resistances that the filament's table predicts.

    Args:
        folder: Folder for the files.
        process: Set the process; see defsense list printers.
    """
    from ...workflow.calibrate.traced_parts import choose_traces, write_trace_coupon

    printing = choose_traces(traces, PrintOptions(process=process))
    if printing is None:
        raise FabricationError(
            "no conductive filament is given",
            code="argument-missing",
            where="trace",
            action="Give one (see defsense list filaments), or a device with traces as --device",
        )
    data = write_trace_coupon(folder, printing).data
    with standard_output():
        if output.json:
            print_json(data)
        else:
            _print_coupon(data, folder)


def _print_coupon(data: dict[str, Any], folder: Path) -> None:
    from rich.table import Table

    table = Table(title=f"Traces of {data['filament']}")
    for column in ("number", "trace", "width (mm)", "length (mm)", "R predicted (ohm)"):
        table.add_column(column, justify="left" if column == "trace" else "right")
    for t in data["traces"]:
        row = (f"{t['width']:g}", f"{t['length']:.1f}", f"{t['resistance']:.0f}")
        table.add_row(str(t["number"]), t["name"], *row)
    console().print(table)
    print_lines(
        [
            f"Look at: {folder}",
            f"Next:    slice it: {SLICE.format(folder=folder)}; print it, measure each trace from"
            f" pad to pad, and run defsense calibrate resistivity {folder} --ohm R1,R2,...",
        ]
    )


@resistivity.default
def _resistivity(
    coupon: Path,
    /,
    *,
    options: Annotated[ResistivityOptions, Parameter(name="*")] = _RESISTIVITY,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Determine a filament's resistivity from the measured coupon of printed traces.

    The resistivity along beads, its multiple between layers, and the resistance of a pad are fitted
    to the resistances by relative least squares, and printed as lines of [cord] for device.toml. A
    table of readings is a CSV file with the columns trace (number or name) and resistance (ohm).

    Args:
        coupon: Folder that 'calibrate trace-coupon' wrote, or its coupon.json.
    """
    from ...workflow.calibrate.fit_resistivity import fit_resistivity, plain_fit

    measured = fit_resistivity(coupon, options)
    with standard_output():
        if output.json:
            print_json(plain_fit(measured))
        else:
            _print_fit(measured)


def _print_fit(measured: MeasuredCoupon) -> None:
    from rich.table import Table

    fit, coupon = measured.fit, measured.coupon
    table = Table(title=f"Coupon of {coupon.filament}")
    for column in ("trace", "R (ohm)", "fitted", "difference", "predicted before"):
        table.add_column(column, justify="left" if column == "trace" else "right")
    rows = zip(measured.trace, measured.resistance, fit.fitted, fit.deviation, strict=True)
    for n, ohm, fitted, deviation in rows:
        trace = coupon.traces[int(n)]
        row = (f"{ohm:.0f}", f"{fitted:.0f}", f"{deviation:+.1%}", f"{trace.resistance:.0f}")
        table.add_row(f"{n + 1} {trace.name}", *row)
    console().print(table)
    layers = fit.between_layers
    print_lines(
        [
            f"resistivity    {fit.resistivity.value:.1f} +- {fit.resistivity.error:.1f} ohm mm"
            f" along beads (the coupon was written for {coupon.resistivity:g})",
            f"between_layers {layers.value:.2f} +- {layers.error:.2f} times that"
            f" (the coupon was written for {coupon.between_layers:g})",
            f"contact        {fit.contact.value:.0f} +- {fit.contact.error:.0f} ohm for each pad",
            *(f"note: {note}" for note in measured.notes),
            "Next:    set these keys in device.toml:",
            *measured.cord_lines,
        ]
    )
