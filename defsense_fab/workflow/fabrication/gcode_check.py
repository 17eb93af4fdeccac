"""Check a sliced print of a device or calibration part with printed traces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.curve import arc_lengths, resample
from ...core.device.build_folder import BUILD_AGAIN
from ...core.device.device import Device
from ...core.errors import FabricationError
from ...geometry.printing.conductors import ConductorReport, check_traces
from ...geometry.printing.conductors import Finding as Finding
from ...geometry.printing.gcode import find_shift, read_beads
from ...geometry.printing.traces import Trace
from ...store.build import Build
from .print_design import PrintDesign, read_design, resistivity_of
from .printed import place_on_bed

CONDUCTIVE_TOOL = 1  # the second extruder, counted from 0
#: Conductive filament in the object, relative to the traces, that only swapped extruders deposit.
MAX_VOLUME_RATIO = 5.0
#: Difference in size from the design, which beads do not explain.
MAX_SIZE_DIFFERENCE_MM = 3.0
_PAD_MARGIN_MM = 0.5  # by which beads of a pad reach beyond it: one line


@dataclass(frozen=True)
class CheckedPrint:
    """A sliced print compared with its design.

    Attributes:
        report: What the print contains of each trace, and its findings.
        expected: Resistance (t,) of each trace by the design, ohm.
        slicer: Name and version of the slicer; empty if the file does not state it.
    """

    report: ConductorReport
    expected: tuple[float, ...]
    slicer: str


def check_gcode(
    device: Device, build: Build, gcode: Path, tool: int = CONDUCTIVE_TOOL
) -> CheckedPrint:
    """Compare the beads of a sliced print with the traces of a built device.

    Args:
        device: The device.
        build: Its build.
        gcode: G-code of its file for a slicer; the slicer may have moved the object on the bed.
        tool: Number of the conductive extruder, from 0.

    Raises:
        FabricationError: The device has no printed traces, or the file is no G-code of it.
        StorageError: The device has no parts.
    """
    spec = device.cord.trace
    manifest = build.manifest if spec is not None else None
    if spec is None or manifest is None or not manifest.traces:
        raise FabricationError(
            "has no printed traces",
            code="no-printed-traces",
            where=device.name,
            action=f'Set [cord] process = "printed" in device.toml. {BUILD_AGAIN}',
        )
    pad = device.pad
    assert pad is not None
    up, bed = np.array(device.fabrication.up), device.fabrication.bed
    body = build.parts[manifest.parts[0].name]
    traces = tuple(
        Trace(
            t.name,
            place_on_bed(t.line, up, body, bed),
            spec.width,
            spec.height,
            place_on_bed(_inner_ends(t.line, pad.depth), up, body, bed),
        )
        for t in manifest.traces
    )
    design = PrintDesign(
        device.name,
        traces,
        sum(t.volume for t in manifest.traces),
        tuple(t.resistance for t in manifest.traces),
        np.array(manifest.plates[0].parts["body"], float),
        resistivity_of(spec),
        place_on_bed(np.concatenate([t.pads for t in manifest.traces]), up, body, bed),
        pad.reach,
    )
    return compare_print(design, gcode, tool)


def check_calibration_gcode(folder: Path, gcode: Path, tool: int = CONDUCTIVE_TOOL) -> CheckedPrint:
    """Compare the beads of a sliced print with the traces of a specimen or coupon.

    Args:
        folder: Folder that a command of `defsense calibrate` wrote.
        gcode: G-code of its file for a slicer; the slicer may have moved the object on the bed.
        tool: Number of the conductive extruder, from 0.

    Raises:
        FabricationError: The folder has no valid `traces.json`, or the file is no G-code of it.
    """
    return compare_print(read_design(folder), gcode, tool)


def compare_print(design: PrintDesign, gcode: Path, tool: int) -> CheckedPrint:
    """Compare the beads of a sliced print with its design.

    Args:
        design: The traces as they were designed.
        gcode: G-code of the object; the slicer may have moved it on the bed.
        tool: Number of the conductive extruder, from 0.

    Raises:
        FabricationError: The file is no G-code of the object.
    """
    low, high = design.bounds
    beads = read_beads(gcode)
    printed = float(beads.volume[(beads.tool == tool) & beads.is_object].sum())
    if printed > MAX_VOLUME_RATIO * design.volume:
        raise FabricationError(
            f"extruder T{tool} deposits {printed:.0f} mm3 in the object, and the traces have"
            f" {design.volume:.0f} mm3",
            code="extruders-swapped",
            where=gcode,
            action="Give the number of the conductive extruder as --tool, or assign the filaments"
            " in the slicer",
            printed=printed,
            designed=design.volume,
        )
    ends = np.concatenate([beads.start[beads.is_object], beads.end[beads.is_object]])
    size, designed_size = np.ptp(ends, axis=0)[:2], (high - low)[:2]
    if (np.abs(size - designed_size) > MAX_SIZE_DIFFERENCE_MM).any():
        raise FabricationError(
            f"prints an object of {size[0]:.0f} x {size[1]:.0f} mm, and {design.name} measures"
            f" {designed_size[0]:.0f} x {designed_size[1]:.0f} mm",
            code="another-object",
            where=gcode,
            action="Slice one copy, neither turned nor scaled",
            size=tuple(size.tolist()),
        )
    shift = find_shift(beads, low, high)
    traces = [trace.move(shift) for trace in design.traces]
    report = check_traces(beads, traces, tool, design.resistivity)
    pads = design.pads + shift
    # A pad is wider than its trace: filament there is neither stray nor a loop.
    kept = [
        f
        for f in report.findings
        if not (_may_be_pad(f) and _is_in_pad(f.point, pads, design.pad_reach))
    ]
    report = replace(report, findings=tuple(kept))
    return CheckedPrint(report, design.expected, beads.slicer)


def _may_be_pad(finding: Finding) -> bool:
    is_own_contact = finding.kind == "bridge" and len(finding.traces) == 1
    return finding.kind == "stray" or is_own_contact


def _is_in_pad(point: Float, mouths: Float, reach: float) -> bool:
    """Return whether conductive filament at a point (3,) is in one of the pads at (n, 3), mm."""
    return bool((np.linalg.norm(mouths - point, axis=1) < reach + _PAD_MARGIN_MM).any())


def _inner_ends(line: Float, depth: float) -> Float:
    """Return the points (2, 3) of a line (p, 3) at which its pads end, mm.

    Between them and the wires there is the fastener, which conducts far better than filament.
    """
    return resample(line, depth, float(arc_lengths(line)[-1]) - depth, 2)
