"""Write calibration parts with printed traces: the bending specimen, and the resistance coupon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.device.cord_tables import CordTable
from ...core.device.device import FabricationSpec
from ...core.device.device_file import load_device
from ...core.device.fabrication_table import FabricationTable
from ...core.device.filaments import TraceSpec, has_second_extruder
from ...core.device.pads import PADS
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...core.progress import Progress, silent
from ...core.storage.files import check_folder, storage_errors
from ...sensing.built_cord import TraceSection
from ..fabrication.print_design import (
    DESIGN_FILE,
    PrintDesign,
    read_design,
    resistivity_of,
    write_design,
)
from .calibration_parts import (
    COUPON_FILE,
    SPECIMEN_FILE,
    Printer,
    PrintFiles,
    PrintPart,
    check_radii,
    choose_offset,
    describe_specimen,
    make_jigs,
    write_prints,
)
from .options import PrintOptions, SpecimenOptions, TraceOptions

if TYPE_CHECKING:
    from ...geometry.specimen.trace_lines import TraceLine

_UP = np.array([0.0, 0.0, 1.0])  # as the parts are printed
_FACET_DEVIATION_MM = 0.01  # of facets from the solid
#: Pads, whose dimples are left out, as clips of a meter hold them.
PAD = PADS["spring-pin"]
#: Length by which a pad shortens its trace, as it is wider. It is 0.3 to 0.6 mm of the pad's 1.2 mm
#: in the network of resistors of the beads of a coupon (PrusaSlicer 2.5, layers of 0.2 mm).
PAD_RELIEF_MM = 0.5
#: Keys of [cord] that options of another name set.
_OPTION_OF_KEY = {"width": "trace_width", "height": "trace_height"}
_DEFAULT_PRINTING, _DEFAULT_SPECIMEN = PrintOptions(), SpecimenOptions()


@dataclass(frozen=True)
class TracePrinting:
    """Printed traces and their printer.

    Attributes:
        trace: Filament and section of the traces.
        fabrication: Printer, with its layers and bed.
    """

    trace: TraceSpec
    fabrication: FabricationSpec

    @property
    def printer(self) -> Printer:
        """Limits of the printer."""
        f = self.fabrication
        return Printer(f.process, f.clearance, f.wall, f.bed, f.kind)

    def describe(self) -> dict[str, Any]:
        """Return filament, section and process for a JSON file."""
        t = self.trace
        return {
            "filament": t.filament,
            "trace_width": t.width,
            "trace_height": t.height,
            "resistivity": t.resistivity,
            "between_layers": t.between_layers,
            "process": self.fabrication.process,
            "layer": self.fabrication.layer,
        }


def choose_traces(
    options: TraceOptions, printing: PrintOptions = _DEFAULT_PRINTING
) -> TracePrinting | None:
    """Return the printed traces that options name.

    Args:
        options: Filament and section, or a device.
        printing: The process; a cord excludes traces.

    Returns:
        The traces and their printer; None if the options name neither a filament nor a device.

    Raises:
        DeviceError: The device is invalid.
        FabricationError: The filament is unknown, a trace is too thin for it, the process has no
            second extruder, options exclude each other, or the device has no printed traces.
    """
    o = options
    if o.trace is not None or o.device is not None:
        _check_exclusive(o, printing)
    if o.device is not None:
        device = load_device(o.device, complete=False)
        if device.cord.trace is None:
            raise FabricationError(
                "has no printed traces",
                code="no-printed-traces",
                where=o.device,
                action='Set [cord] process = "printed", or give the filament instead of the device',
            )
        return TracePrinting(device.cord.trace, device.fabrication)
    if o.trace is None:
        for name in ("trace_width", "trace_height"):
            if getattr(o, name) is not None:
                raise FabricationError(
                    "is for printed traces",
                    code="argument-missing",
                    where=name,
                    action="Give a conductive filament, too",
                )
        return None
    Printer.from_name(printing.process)  # refuses unknown names
    if not has_second_extruder(printing.process):
        raise FabricationError(
            f"printed traces need a printer with two extruders, and {printing.process!r} has none",
            code="printer-without-second-extruder",
            where="process",
            action="Use a process whose name starts with fdm",
            process=printing.process,
        )
    table = CordTable(process="printed", trace=o.trace, width=o.trace_width, height=o.trace_height)
    for problem in table.check():
        key = str(problem.path[0])
        raise FabricationError(
            problem.text,
            code=problem.code,
            where=_OPTION_OF_KEY.get(key, key),
            action=problem.action,
            **problem.data,
        )
    trace = table.record(Path()).trace
    assert trace is not None
    return TracePrinting(trace, FabricationTable(process=printing.process).record())


def _check_exclusive(options: TraceOptions, printing: PrintOptions) -> None:
    """Refuse options that another option replaces."""
    others = ["cord"] if printing.cord != _DEFAULT_PRINTING.cord else []
    reason = "printed traces replace the cord"
    if options.device is not None and not others:
        others = [
            name
            for name in ("trace", "trace_width", "trace_height")
            if getattr(options, name) is not None
        ]
        if printing.process != _DEFAULT_PRINTING.process:
            others.append("process")
        reason = "the device states it"
    if others:
        raise FabricationError(
            reason, code="options-exclusive", where=others[0], action="Leave one of them out"
        )


def write_traced_specimen(
    folder: Path,
    traces: TracePrinting,
    options: SpecimenOptions = _DEFAULT_SPECIMEN,
    progress: Progress = silent,
) -> PrintFiles:
    """Write a specimen that is printed in one piece with its traces, its jigs and `specimen.json`.

    Args:
        folder: Folder for the files.
        traces: The traces and their printer.
        options: Sizes of the specimen and the jigs.
        progress: Called with the progress.

    Returns:
        The files.

    Raises:
        FabricationError: A part is not possible, or too large for the bed.
        StorageError: A file cannot be written.
    """
    from ...geometry.specimen.specimen import Specimen, make_whole
    from ...geometry.specimen.trace_lines import specimen_traces

    trace, printer = traces.trace, traces.printer
    check_radii(options.radii)
    offset, warnings = choose_offset(options.offset, trace.height, printer)
    # The jigs are those of a specimen with cords, whose end stops leave as much room for wires.
    room = max(Specimen.channel_diameter, trace.height)
    specimen = Specimen(
        options.length, options.thickness, options.width, offset, room, printer.clearance
    )
    lines = specimen_traces(specimen, trace.width, trace.height, PAD.diameter)
    check_folder(folder)
    jigs = make_jigs(specimen, sorted(options.radii), progress)
    data = describe_specimen(specimen, sorted(options.radii), warnings) | {
        "channel_diameter": trace.height,
        "cord": trace.filament,
        **traces.describe(),
        "traces": [_describe_trace(n, line, trace) for n, line in enumerate(lines, 1)],
    }
    part = _TracedPart.make("specimen", make_whole(specimen), lines)
    return _write(folder, traces, part, jigs, data, SPECIMEN_FILE)


def write_trace_coupon(folder: Path, traces: TracePrinting) -> PrintFiles:
    """Write the resistance coupon of printed traces, and `coupon.json`.

    `coupon.json` has the resistance of each trace that the filament's numbers predict.

    Args:
        folder: Folder for the files.
        traces: The traces and their printer.

    Returns:
        The files.

    Raises:
        FabricationError: The bed is too small for the coupon.
        StorageError: A file cannot be written.
    """
    from ...geometry.specimen.trace_coupon import SLOPE, coupon_rows, make_coupon_block

    t = traces.trace
    rows = coupon_rows(t.width, t.height, traces.fabrication.layer, PAD.diameter)
    check_folder(folder)
    lines = [row.trace for row in rows]
    part = _TracedPart.make("coupon", make_coupon_block(rows), lines)
    # A slope is a check of the model: its resistance depends on how its beads are stacked.
    described = [
        _describe_trace(n, line, t) | {"fitted": line.name != SLOPE}
        for n, line in enumerate(lines, 1)
    ]
    data = traces.describe() | {"traces": described}
    return _write(folder, traces, part, {}, data, COUPON_FILE)


def _describe_trace(number: int, line: TraceLine, spec: TraceSpec) -> dict[str, Any]:
    """Return a trace for a JSON file: its sizes, and what its resistance consists of."""
    along, between = _length_per_area(line)
    return {
        "number": number,
        "name": line.name,
        "width": line.width,
        "height": line.height,
        "length": float(np.linalg.norm(np.diff(line.points, axis=0), axis=1).sum()),
        "along": along,
        "between": between,
        "resistance": spec.resistivity * (along + spec.between_layers * between),
    }


def _length_per_area(line: TraceLine) -> tuple[float, float]:
    """Return length per cross-section (1/mm) that conducts along beads and between layers."""
    section = TraceSection(line.width, line.height, _UP, 1.0)
    points = line.points - PAD_RELIEF_MM * np.array(
        [line.outward[0], *np.zeros((len(line.points) - 2, 3)), line.outward[1]]
    )
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1) / (line.width * line.height)
    along, between = section.resistance_shares(points)
    return float(along @ steps), float(between @ steps)


@dataclass(frozen=True)
class _TracedPart:
    """A part and its traces, centered on the bed, with its lowest point at z = 0.

    Attributes:
        name: Name of the part.
        body: Surface of the part without the traces.
        traces: Surfaces of the traces by name.
        lines: Lines of the traces.
    """

    name: str
    body: Surface
    traces: Mapping[str, Surface]
    lines: Sequence[TraceLine]

    @classmethod
    def make(cls, name: str, solid: Any, lines: Sequence[TraceLine]) -> _TracedPart:
        """Cut traces out of a TopoDS_Solid that is printed with z up."""
        from ...geometry.kernels import occ, triangle_kernel
        from ...geometry.kernels.cutting_tools import axes_from_normal
        from ...geometry.parts.printed_pads import PlacedPad
        from ...geometry.parts.printed_traces import TraceShape, cut_traces_out, make_trace

        def sweep(line: TraceLine) -> Any:
            first, last = (
                PlacedPad(PAD, axes_from_normal(out), mouth, line.name)
                for out, mouth in zip(line.outward, line.points[[0, -1]], strict=True)
            )
            shape = TraceShape(line.width, line.height, _UP, PAD)
            return make_trace(line.points, shape, (first, last))

        whole = triangle_kernel.to_manifold(occ.tessellate(solid, _FACET_DEVIATION_MM), name)
        bounds = triangle_kernel.to_surface(whole).bounds
        move = -np.append(bounds.mean(axis=0)[:2], bounds[0][2])
        lines = [replace(line, points=line.points + move) for line in lines]
        swept = {line.name: sweep(line) for line in lines}
        body, traces, _ = cut_traces_out(whole.translate(move.tolist()), swept)
        surfaces = {
            key: triangle_kernel.to_printable_surface(trace, key) for key, trace in traces.items()
        }
        return cls(name, triangle_kernel.to_printable_surface(body, name), surfaces, lines)


def _write(
    folder: Path,
    printing: TracePrinting,
    part: _TracedPart,
    others: Mapping[str, PrintPart],
    data: dict[str, Any],
    file: str,
) -> PrintFiles:
    """Write a part for slicers, other parts, and last a JSON file."""
    from ...geometry.printing.slicer_files import ColoredSolid
    from ...geometry.printing.traces import Trace
    from ..fabrication.printed import write_slicer_files

    if (folder / DESIGN_FILE).is_file() and (earlier := read_design(folder).name) != part.name:
        raise FabricationError(
            f"has the files of a {earlier}, which those of the {part.name} would replace",
            code="folder-in-use",
            where=folder,
            action="Choose another folder",
        )
    parts = {part.name: PrintPart(part.body)}
    parts |= {name: PrintPart(surface) for name, surface in part.traces.items()}
    printing.printer.check_sizes({n: p.size for n, p in (parts | dict(others)).items()})
    bed = printing.fabrication.bed
    middle = np.array([bed[0] / 2, bed[1] / 2, 0.0])

    def lie(surface: Surface) -> Surface:
        return Surface(surface.vertices + middle, surface.faces)

    solids = [ColoredSolid(part.name, lie(part.body), 1)]
    solids += [ColoredSolid(n, lie(s), 2, is_trace=True) for n, s in part.traces.items()]
    design = PrintDesign(
        part.name,
        tuple(Trace(t.name, t.points + middle, t.width, t.height) for t in part.lines),
        sum(s.volume for s in part.traces.values()),
        tuple(float(t["resistance"]) for t in data["traces"]),
        np.array(solids[0].surface.bounds),
        resistivity_of(printing.trace),
        np.concatenate([t.points[[0, -1]] for t in part.lines]) + middle,
        PAD.reach,
    )
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        files = write_slicer_files(solids, printing.fabrication, folder, part.name)
        write_design(design, folder)
    data["slicer_files"] = list(files)
    return write_prints(folder, parts | dict(others), data, file)
