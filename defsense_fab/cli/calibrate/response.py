"""The commands `defsense calibrate fit | twin`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from ...workflow.calibrate.options import FitOptions, SimulatedSpecimenOptions, TableOptions
from ..app import command
from ..output import OutputOptions, print_json, print_lines, progress_bars, standard_output

_RESPONSE = Path("response.json")
_TABLES, _FIT, _SIMULATED = TableOptions(), FitOptions(), SimulatedSpecimenOptions()
_OUTPUT = OutputOptions()

fit = command(
    "fit",
    "defsense calibrate fit my-specimen/session-1 my-specimen/session-2",
    "defsense calibrate fit readings.csv --thickness 15 --offset 2 --out response.json",
)
twin = command("twin", "defsense calibrate twin my-twin --k 2 --lengths 150,200 --seed 1")


@fit.default
def _fit(
    sources: Annotated[tuple[Path, ...], Parameter(metavar="SESSION|CSV")],
    /,
    *,
    out: Path = _RESPONSE,
    tables: Annotated[TableOptions, Parameter(name="*")] = _TABLES,
    options: Annotated[FitOptions, Parameter(name="*")] = _FIT,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Fit the cord's response to sessions or tables of readings.

    The response w(eps) is the relative change of resistance as a function of strain. It is written
    with its 95 % interval, and a report next to it. Sessions are folders of 'calibrate record'. A
    table is a CSV file with the columns specimen, jig_radius (mm of the jig's surface, empty when
    flat), channel (top, neutral or bottom; the bottom lies on the jig), resistance (ohm);
    optionally round and face.

    Args:
        sources: Sessions or tables of readings.
        out: Set the output file; the report has the same name with .html.
    """
    from ...workflow.calibrate.fit_response import fit_response

    with progress_bars(output) as progress:
        result = fit_response(sources, out, tables=tables, options=options, progress=progress)
    with standard_output():
        if output.json:
            print_json(result.data)
        else:
            print_lines(_describe_fit(result.data, out))


def _describe_fit(data: dict[str, Any], out: Path) -> list[str]:
    low, high = data["interval"]
    smallest, largest = data["strain_range"]
    drift = "none" if data["neutral_drift"] is None else f"{data['neutral_drift']:+.2%}"
    return [
        f"k_res = {data['k_res']:.2f}  (95 %: {low:.2f} to {high:.2f})",
        data["reason"],
        f"strains {smallest:.1%} to {largest:.1%}, {data['readings']} readings of"
        f" {len(data['pieces'])} pieces; drift of the neutral cord: {drift}",
        *(f"note: {warning}" for warning in data["warnings"]),
        f"Look at: {out.with_suffix('.html')}",
        f"Next:    copy {out} to the device folder and set [cord] response ="
        f' "{out.name}" in its device.toml',
    ]


@twin.default
def _twin(
    folder: Path,
    /,
    *,
    options: Annotated[SimulatedSpecimenOptions, Parameter(name="*")] = _SIMULATED,
    output: OutputOptions = _OUTPUT,
) -> None:
    """Create sessions of a simulated specimen, to try the fit.

    The simulated specimens have noise, hysteresis, relaxation and differences between pieces. There
    is no waiting time as in a measurement.

    Args:
        folder: Folder for the sessions, one per specimen.
    """
    from ...workflow.calibrate.simulated_specimens import simulate_specimens

    with progress_bars(output) as progress:
        sessions = [str(s) for s in simulate_specimens(folder, options, progress=progress)]
    with standard_output():
        if output.json:
            print_json({"sessions": sessions})
        else:
            out = folder / _RESPONSE
            print_lines([f"Next:    defsense calibrate fit {' '.join(sessions)} --out {out}"])
