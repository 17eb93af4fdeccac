"""Read `device.toml` into a Device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from ..errors import CalibrationError, DeviceError
from ..schema.declare import Problem, Table, key, unknown_choice
from ..schema.document import Document, load_document, parse_document
from ..schema.types import is_number
from ..storage.file_names import fold_name, name_problem
from .cord_tables import CordTable
from .device import CordSpec, Device, FabricationSpec, Pose
from .device_tables import (
    BodyTable,
    DesignTable,
    MeshTable,
    OutputsTable,
    ReadoutTable,
    RegionTable,
    WiresTable,
)
from .fabrication_table import FabricationTable
from .filaments import TraceSpec, has_second_extruder
from .material_table import MaterialTable
from .materials import find_process_problem
from .pads import PADS
from .pose_tables import PoseTable, StatesTable, check_pose_names, repeated_states
from .prices import PricesTable
from .regions import HalfSpace, hull_points
from .sensor_tables import SensorTable

DEVICE = "device.toml"
#: Largest Young's modulus of a trace's filament, in moduli of the body.
MAX_STIFFNESS_RATIO = 100.0
#: Lines across and layers over each other in a trace. Sliced by PrusaSlicer 2.5, vertical traces of
#: 1.3 to 1.7 lines had gaps, and a level one of 1.5 layers 1.6 times its resistance; 2 are enough.
_MIN_TRACE_BEADS = 2


class DeviceFile(Table, frozen=True, kw_only=True):
    """All keys of `device.toml`."""

    schema: Annotated[Literal[1], key("Version of this format; `docs/device.md` has all keys.")] = 1
    name: Annotated[str, key("Name of the device in its report and files.")]
    body: Annotated[BodyTable, key("The body.")]
    material: Annotated[MaterialTable, key("The material of the body.")]
    mesh: Annotated[MeshTable, key("The tetrahedra of the body.")]
    regions: Annotated[
        dict[str, RegionTable],
        key("Named parts of the body in mm, by which poses hold and move it."),
    ] = msgspec.field(default_factory=dict)
    poses: Annotated[
        tuple[PoseTable, ...], key("Poses that the device senses.", default="needed by a build")
    ] = ()
    states: Annotated[StatesTable, key("Fractions and mixtures of the poses.")] = msgspec.field(
        default_factory=StatesTable
    )
    outputs: Annotated[OutputsTable, key("What is decoded from the cords.")] = msgspec.field(
        default_factory=OutputsTable
    )
    cord: Annotated[CordTable, key("The conductive cord, whose resistance indicates its stretch.")]
    readout: Annotated[ReadoutTable, key("What measures the cords.")] = msgspec.field(
        default_factory=ReadoutTable
    )
    wires: Annotated[WiresTable, key("Where wires leave the body.")] = msgspec.field(
        default_factory=WiresTable
    )
    fabrication: Annotated[FabricationTable, key("Printer, parts and joints.")] = msgspec.field(
        default_factory=FabricationTable
    )
    design: Annotated[DesignTable, key("What is found automatically.")] = msgspec.field(
        default_factory=DesignTable
    )
    prices: Annotated[PricesTable, key("What you pay, for the cost.")] = msgspec.field(
        default_factory=PricesTable
    )
    sensors: Annotated[
        tuple[SensorTable, ...],
        key("Cords that are drawn: points in a plane, in mm; none if all are to be found."),
    ] = ()

    def check(self) -> Iterator[Problem]:
        """Yield problems of names: of the device, poses, cords and regions."""
        if not self.name.isprintable():
            text = f"must be one line of letters, not {self.name!r}"
            yield Problem(("name",), text, "name-invalid")
        yield from (p.below("poses") for p in check_pose_names(self.poses))
        for number, pose in enumerate(self.poses):
            for path, region in pose.regions():
                if region not in self.regions:
                    yield self._unknown_region(("poses", number, *path), region)
        if self.outputs.anchor is not None and self.outputs.anchor not in self.regions:
            yield self._unknown_region(("outputs", "anchor"), self.outputs.anchor)
        for number, name in enumerate(self.wires.exit or ()):
            if name not in self.regions:
                yield self._unknown_region(("wires", "exit", number), name)
        for number, name in enumerate(self.fabrication.keep_whole):
            path = ("fabrication", "keep_whole", number)
            if name not in self.regions:
                yield self._unknown_region(path, name)
            elif self.regions[name].half_space is not None:
                text = f"{name!r} is a half-space, which a cord would have to avoid everywhere"
                yield Problem(path, text, "region-unbounded", "Use a box, ball or cylinder")
        names = [pose.name for pose in self.poses]
        yield from (p.below("states") for p in self.states.check_poses(names))
        cords = [sensor.name for sensor in self.sensors]
        for number, name in enumerate(cords):
            path = ("sensors", number, "name")
            if not name.isprintable():
                text = f"must be one line of letters, not {name!r}"
                yield Problem(path, text, "name-invalid")
            if name in cords[:number]:
                text = f"{name!r} is used already"
                yield Problem(path, text, "name-repeated", "Choose another name")
        if self.design.sensors is not None and self.design.sensors < len(cords):
            text = f"counts all cords, and {len(cords)} are drawn"
            yield Problem(("design", "sensors"), text, "too-few-sensors", "Increase or remove it")

    def _unknown_region(self, path: tuple[str | int, ...], name: str) -> Problem:
        return unknown_choice(path, name, self.regions, "region", "unknown-region")


def load_device(
    folder: Path,
    overrides: Mapping[str, Any] | None = None,
    complete: bool = True,
    cords: bool = True,
) -> Device:
    """Read the `device.toml` of a folder.

    Args:
        folder: Folder of the file, and of the files that it names.
        overrides: Parameters of the body's script that replace those of the file.
        complete: Whether there must be poses and sensors.
        cords: Whether a complete device must have sensors; a simulation needs none.

    Raises:
        DeviceError: with file, line and key, for everything unknown, missing or out of range.
    """
    return read_device(load_document(folder / DEVICE), folder, overrides or {}, complete, cords)


def parse_device(text: str, folder: Path, complete: bool = True) -> Device:
    """Read the text that a device's file has, or would have, in its `folder`; see `load_device`."""
    return read_device(parse_document(text, folder / DEVICE), folder, {}, complete)


def read_device(
    document: Document,
    folder: Path,
    overrides: Mapping[str, Any],
    complete: bool = True,
    cords: bool = True,
) -> Device:
    """Read a file whose values may have been replaced; see `load_device`."""
    declared = document.read(DeviceFile)
    problems = [
        *_missing_tables(declared, complete, cords),
        *_check_body(declared, folder, overrides),
        *_check_agreement(declared),
    ]
    poses = tuple(pose.record() for pose in declared.poses)
    states = declared.states.record(poses)
    repeated = repeated_states(states, [pose.name for pose in poses])
    problems += [problem.below("states") for problem in repeated]
    fabrication = declared.fabrication.record()
    if declared.cord.is_printed:
        fabrication = _printed_whole(fabrication)
    cord: CordSpec | None = None
    try:
        cord = declared.cord.record(folder)
    except CalibrationError as error:
        text = f"{error.where}: {error.problem}" if error.where else error.problem
        problems.append(Problem(("cord", "response"), text, error.code, error.action))
    else:
        problems += _check_cord(declared, cord, fabrication)
    exits = _exits(declared, poses)
    problems += _check_pad(declared, exits)
    if problems or cord is None:
        document.refuse(problems)
    body = msgspec.structs.replace(
        declared.body, parameters={**declared.body.parameters, **overrides}
    )
    design, drawn = declared.design, len(declared.sensors)
    return Device(
        name=declared.name,
        source=folder,
        body=body.record(folder),
        material=declared.material.record(),
        mesh=declared.mesh.record(),
        regions={name: region.shape() for name, region in declared.regions.items()},
        poses=poses,
        states=states,
        outputs=declared.outputs.record(),
        cord=cord,
        fabrication=fabrication,
        sensors=tuple(sensor.record() for sensor in declared.sensors),
        propose=(design.sensors or drawn) - drawn,
        planes=design.planes,
        decoder=design.decoder,
        prefer=design.prefer,
        converter=declared.readout.used_converter,
        board=declared.readout.board,
        seed=design.seed,
        searches=design.searches,
        exits=exits,
        pad=PADS[_pad_name(declared)] if declared.cord.is_printed else None,
        prices=declared.prices.record(),
        parts=design.parts,
    )


def _exits(declared: DeviceFile, poses: Sequence[Pose]) -> tuple[str, ...]:
    """Return the regions of exits: as stated, or of traces those that all poses hold."""
    if declared.wires.exit is not None:
        return declared.wires.exit
    if not declared.cord.is_printed or not poses:
        return ()
    held = set.intersection(*(set(pose.fixed) for pose in poses))
    return tuple(sorted(held))


def _pad_name(declared: DeviceFile) -> str:
    """Return the name of the pads of printed traces."""
    return declared.wires.pad or next(iter(PADS))


def _check_pad(declared: DeviceFile, exits: Sequence[str]) -> Iterator[Problem]:
    """Yield problems of the pads of printed traces, and of the regions that they are in."""
    if not declared.cord.is_printed:
        if declared.wires.pad is not None:
            text = "cords have no pads, only printed traces do"
            yield Problem(("wires", "pad"), text, "key-not-applicable", "Remove it")
        return
    if not exits or any(name not in declared.regions for name in exits):
        return
    shapes = [declared.regions[name].shape() for name in exits]
    if any(isinstance(shape, HalfSpace) for shape in shapes):
        return
    # Regions are solid: the skin in one is at most as wide as its second largest side.
    width = max(float(np.sort(np.ptp(hull_points(shape), axis=0))[1]) for shape in shapes)
    pad = PADS[_pad_name(declared)]
    if width < pad.room:
        yield Problem(
            ("wires", "pad" if declared.wires.exit is None else "exit"),
            f"pads for {pad.name!r} need {pad.room:g} mm, and no region of exits"
            f" ({', '.join(exits)}) is wider than {width:.3g} mm",
            "exit-too-small",
            "Enlarge a region, name another one in exit, or use smaller pads",
            {"pad": pad.name, "needed": pad.room, "width": width},
        )


def _printed_whole(fabrication: FabricationSpec) -> FabricationSpec:
    """Return the settings for a body that is printed in one piece, with its traces in it."""
    return replace(
        fabrication, assembly="bonded", prestretch=None, pockets=False, lead=0.0,
        strain_relief=False, limit_cuts=False,
    )  # fmt: skip


def _missing_tables(declared: DeviceFile, complete: bool, cords: bool) -> Iterator[Problem]:
    if complete and not declared.poses:
        yield Problem(
            ("poses",),
            "there are no poses that the device must sense",
            "poses-missing",
            "Add [[poses]]; `defsense modes` proposes some",
        )
    if complete and cords and not declared.sensors and declared.design.sensors is None:
        yield Problem(
            ("sensors",),
            "there are no cords",
            "sensors-missing",
            "Draw [[sensors]] with planes and paths, or give [design] sensors = 3",
        )


def _check_body(
    declared: DeviceFile, folder: Path, overrides: Mapping[str, Any]
) -> Iterator[Problem]:
    body = declared.body
    path = folder / getattr(body, body.kind)
    if not path.is_file():
        yield Problem(("body", body.kind), f"no such file: {path}", "file-not-found")
    if overrides and body.kind != "script":
        yield Problem(
            ("body", body.kind),
            f"this body has no parameters, and {', '.join(overrides)} is to be replaced",
            "parameters-without-script",
            "Replace parameters of scripts only",
        )
    for name, value in overrides.items():
        before = body.parameters.get(name)
        if is_number(before) and not is_number(value):
            raise DeviceError(
                f"{value!r} is not a number, and {DEVICE} has the number {before}",
                code="not-a-number",
                where=f"parameter {name}",
                action=f"Give a number, as in {name}={before}",
                parameter=name,
            )
        if isinstance(value, int | float) and not isinstance(value, bool) and not is_number(value):
            text = f"{name} must be a finite number, not {value!r}"
            yield Problem(("body", "parameters"), text, "not-finite", data={"parameter": name})


def _check_agreement(declared: DeviceFile) -> Iterator[Problem]:
    """Yield problems of keys in one table that exclude those in another."""
    problem = find_process_problem(declared.material.name, declared.fabrication.row["name"])
    if problem is not None:
        yield problem.below("material")
    if declared.body.bay is not None and not declared.fabrication.pockets:
        yield Problem(
            ("fabrication", "pockets"),
            "wires to the connector bay start in pockets",
            "bay-without-pockets",
            "Remove this key, or the bay",
        )


def _check_traces(declared: DeviceFile, trace: TraceSpec) -> Iterator[Problem]:
    """Yield problems of traces that cannot be printed as [fabrication] and [body] state."""
    row = declared.fabrication.row
    if not has_second_extruder(row["name"]):
        yield Problem(
            ("fabrication", "process"),
            f"printed traces need a printer with two extruders, and {row['name']!r} has none",
            "printer-without-second-extruder",
            "Use a process whose name starts with fdm",
        )
    f = declared.fabrication.record()
    for name, size, bead, beads in (
        ("width", trace.width, f.line, "lines"),
        ("height", trace.height, f.layer, "layers"),
    ):
        if size < _MIN_TRACE_BEADS * bead * (1 - 1e-9):
            yield Problem(
                ("cord", name),
                f"a trace of {size:g} mm has less than {_MIN_TRACE_BEADS} {beads} of {bead:g} mm"
                " and would have gaps",
                "trace-too-thin",
                f"Use {_MIN_TRACE_BEADS * bead:g} mm or more, or less [fabrication] {beads[:-1]}",
            )
    for name in ("planes", "parts"):
        if getattr(declared.design, name) is not None:
            text = f"printed traces need no {name}, as the body is not cut"
            yield Problem(("design", name), text, "key-not-applicable", "Remove it")
    if declared.body.bay is not None:
        text = "wires reach printed traces at pads on the skin, so a bay is not used"
        yield Problem(("body", "bay"), text, "bay-with-traces", "Remove it")
    folded = [fold_name(sensor.name) for sensor in declared.sensors]
    for number, sensor in enumerate(declared.sensors):
        is_taken = folded[number] in ("body", "1-whole", *folded[:number])
        problem = name_problem(sensor.name)
        if is_taken or problem:
            text = problem or f"{sensor.name!r} names another file of the parts"
            yield Problem(("sensors", number, "name"), text, "name-invalid", "Choose another name")
    young = declared.material.record().young_modulus
    if trace.young_modulus > MAX_STIFFNESS_RATIO * young:
        yield Problem(
            ("cord", "trace"),
            f"{trace.filament} of {trace.young_modulus:g} MPa is more than"
            f" {MAX_STIFFNESS_RATIO:g} times as stiff as the body of {young:.3g} MPa, whose"
            " deformation it would prevent",
            "trace-too-stiff",
            "Use a stiffer body, a softer filament, or cords",
        )


def _check_cord(
    declared: DeviceFile, cord: CordSpec, fabrication: FabricationSpec
) -> Iterator[Problem]:
    """Yield problems of a cord that cannot be built in as [fabrication] states."""
    if cord.trace is not None:
        yield from _check_traces(declared, cord.trace)
        return
    for number, sensor in enumerate(declared.sensors):
        if sensor.plane is None:
            text = "a cord needs a plane, in which the body is cut"
            path = ("sensors", number, "plane")
            yield Problem(path, text, "plane-missing", 'Give it, or [cord] process = "printed"')
    lead = 0.0 if fabrication.pockets else fabrication.lead
    yield from (problem.below("cord") for problem in declared.cord.check_length(lead))
    wire = fabrication.wire_diameter
    if fabrication.pockets and wire >= cord.ferrule_diameter:
        yield Problem(
            ("fabrication", "wire_diameter"),
            f"a wire of {wire:g} mm is not thinner than the ferrule of"
            f" {cord.ferrule_diameter:g} mm, which would follow it out of its pocket",
            "wire-too-thick",
            "Use a thinner wire or a wider ferrule",
        )
    if not fabrication.prestretch:
        return
    if fabrication.assembly == "bonded":
        yield Problem(
            ("fabrication", "prestretch"),
            "a bonded cord is glued without stretching it",
            "prestretch-bonded",
            'Remove it, or use assembly = "held"',
        )
    if fabrication.prestretch >= cord.max_strain:
        yield Problem(
            ("fabrication", "prestretch"),
            f"the cord {cord.name!r} withstands strains up to {cord.max_strain:g}",
            "prestretch-too-large",
            "Reduce it",
        )
