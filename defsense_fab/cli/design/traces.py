"""Command `defsense traces`: check the G-code of a device or part with printed traces."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from ...core.errors import FabricationError
from ..app import command
from ..device import DeviceFolder
from ..output import OutputOptions, console, print_json, print_lines, silent_stdout, standard_output

if TYPE_CHECKING:
    from ...workflow.fabrication.gcode_check import CheckedPrint, Finding

_NO_OUTPUT = OutputOptions()
#: What a finding is, and the unit of its size.
_KINDS = {
    "gap": ("gap", "mm"),
    "neck": ("narrow cross-section", "mm2"),
    "bridge": ("contact", "mm2"),
    "stray": ("conductive filament outside of all traces", "mm3"),
    "wrong-extruder": ("filament of the other extruder", "mm3"),
}

traces = command("traces", "defsense traces my-device my-device.gcode")


@traces.default
def _traces(
    folder: DeviceFolder,
    gcode: Path,
    /,
    *,
    tool: int = 1,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Check a sliced print for gaps, necks and bridges of its printed traces.

    Slice one of the device's 3MF files (docs/printed.md), and give the G-code before you print it.
    Specimens and coupons with printed traces are checked the same way.

    Args:
        folder: Set the folder that contains device.toml, or that of a specimen or coupon.
        gcode: Set the G-code file of the slicer.
        tool: Set the number of the conductive extruder, T0, T1 and so on.
    """
    from ...core.device.device_file import DEVICE, load_device
    from ...workflow.build.results import last_build
    from ...workflow.fabrication.gcode_check import check_calibration_gcode, check_gcode
    from ...workflow.fabrication.print_design import DESIGN_FILE

    with silent_stdout():
        if (folder / DEVICE).is_file() or not (folder / DESIGN_FILE).is_file():
            device = load_device(folder)
            checked = check_gcode(device, last_build(device), gcode, tool)
        else:
            checked = check_calibration_gcode(folder, gcode, tool)
    with standard_output():
        if output.json:
            print_json(_to_plain(checked))
        else:
            _show(checked)
    findings = checked.report.findings
    if findings:
        raise FabricationError(
            f"does not print {'its traces' if len(findings) > 1 else 'a trace'} as designed:"
            f" {len(findings)} finding{'s' * (len(findings) > 1)}",
            code="print-differs",
            where=gcode,
            action="Change the slicer's settings at these places, or the traces, and slice again",
            findings=[f.kind for f in findings],
        )


def _show(checked: CheckedPrint) -> None:
    table = Table(title=f"Traces{f' by {checked.slicer}' if checked.slicer else ''}")
    for column in ("trace", "connected", "length (mm)", "R0 (ohm)", "by design", "neck (mm2)"):
        table.add_column(column, justify="left" if column == "trace" else "right")
    for trace, expected in zip(checked.report.traces, checked.expected, strict=True):
        table.add_row(
            trace.name,
            "yes" if trace.is_connected else "no",
            f"{trace.length:.0f}",
            f"{trace.resistance:.0f}",
            f"{expected:.0f}",
            f"{trace.neck_area:.2f}",
        )
    console().print(table)
    print_lines(_describe(f) for f in checked.report.findings)
    print_lines(f"note: {warning}" for warning in checked.report.warnings)


def _describe(finding: Finding) -> str:
    what, unit = _KINDS[finding.kind]
    of = f" of {' and '.join(finding.traces)}" if finding.traces else ""
    x, y, z = finding.point
    return f"{what}{of} at ({x:.1f}, {y:.1f}, {z:.1f}) mm on the bed: {finding.size:.2g} {unit}"


def _to_plain(checked: CheckedPrint) -> dict[str, object]:
    return {
        "slicer": checked.slicer,
        "traces": [
            {
                "name": t.name,
                "connected": t.is_connected,
                "length": t.length,
                "resistance": t.resistance if t.is_connected else None,
                "expected": expected,
                "neck_area": t.neck_area,
            }
            for t, expected in zip(checked.report.traces, checked.expected, strict=True)
        ],
        "findings": [
            {"kind": f.kind, "traces": list(f.traces), "at": f.point.tolist(), "size": f.size}
            for f in checked.report.findings
        ],
    }
