"""`device.toml` to a Device, with every key checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..curves.curve import Hermite, Plane, catmull_rom
from ..errors import DeviceError
from ..storage.toml_table import Table, is_number, load_toml, parse_toml
from .catalogue import read_rows
from .cord_table import read_cord
from .device import (
    ASSEMBLIES,
    CONVERTERS,
    DECODERS,
    FREEDOMS,
    PREFERENCES,
    BaySpec,
    BodyKind,
    BodySpec,
    CordSpec,
    Device,
    FabricationSpec,
    MeshSpec,
    OutputsSpec,
    Sensor,
)
from .material_table import read_material
from .pose_file import read_poses, read_states
from .regions import Box, Cylinder, HalfSpace, Shape, Sphere, flaw
from .silicone import silicone

SCHEMA = 1
DEVICE = "device.toml"
MOST_COPIES = 100
MOST_SHRINKAGE = 0.1
#: Least and greatest relative accuracy of signals that a mesh may be asked for.
ACCURACIES = (0.0001, 0.2)
#: Least and greatest edge of what a printer makes, mm.
BEDS = (30.0, 5000.0)
#: Width, height and depth of a connector bay, mm: a row of header pins or a JST-XH of 4 ways.
BAY = (14.0, 7.0, 8.0)


def load_device(
    folder: Path, overrides: Mapping[str, Any] | None = None, complete: bool = True
) -> Device:
    """Read `folder/device.toml`; `overrides` replace parameters of the body's script.

    Without `complete` there need not be poses or sensors yet.

    Raises DeviceError with file, line and key for anything unknown, missing or out of range.
    """
    return read_device(load_toml(folder / DEVICE), folder, overrides or {}, complete)


def parse_device(text: str, folder: Path, complete: bool = True) -> Device:
    """The same of the text that the device's file has, or would have, in its `folder`."""
    return read_device(parse_toml(text, folder / DEVICE), folder, {}, complete)


def read_device(
    top: Table, folder: Path, overrides: Mapping[str, Any], complete: bool = True
) -> Device:
    """The same of the table that the file holds, whose values may have been replaced."""
    if top.raw("schema", 1) is not SCHEMA:
        top.fail("schema", f"this version reads schema {SCHEMA}, not {top.data['schema']!r}")
    regions = _regions(top.table("regions", required=False))
    poses = read_poses(top, list(regions), complete)
    fabrication = _fabrication(top.table("fabrication", required=False))
    hanging = 0.0 if fabrication.pockets else fabrication.lead
    cord = read_cord(top.table("cord"), hanging, folder)
    sensors = _sensors(top)
    body = _body(top.table("body"), folder, overrides)
    _agree(top, body, cord, fabrication)
    _stretching(top, cord, fabrication)
    readout = top.table("readout", required=False)
    converter = readout.string("converter", next(iter(CONVERTERS)))
    readout.choice("converter", converter, list(CONVERTERS), "converter")
    readout.done()
    design = top.table("design", required=False)
    wanted = design.count("sensors")
    planes = design.count("planes")
    decoder = design.string("decoder", "auto")
    design.choice("decoder", decoder, (*DECODERS, "auto"), "decoder")
    prefer = design.string("prefer", PREFERENCES[0])
    design.choice("prefer", prefer, PREFERENCES, "preference")
    seed, searches = design.count("seed", Device.seed), design.count("searches")
    design.done()
    if complete and not sensors and not wanted:
        top.fail("sensors", "draw [[sensors]] with planes and paths, or give [design] sensors = 3")
    if wanted is not None and wanted < len(sensors):
        design.fail("sensors", f"counts all cords, and {len(sensors)} are drawn")
    name = top.string("name")
    if not name.isprintable():
        top.fail("name", f"must be one line of letters, not {name!r}")
    device = Device(
        name=name,
        source=folder,
        body=body,
        material=read_material(top.table("material")),
        mesh=_mesh(top.table("mesh")),
        regions=regions,
        poses=poses,
        states=read_states(top.table("states", required=False), poses),
        outputs=_outputs(top.table("outputs", required=False), list(regions)),
        cord=cord,
        fabrication=fabrication,
        sensors=sensors,
        propose=(wanted or len(sensors)) - len(sensors),
        planes=planes,
        decoder=decoder,
        prefer=prefer,
        converter=converter,
        seed=seed,
        searches=searches,
    )
    top.done()
    return device


def _agree(top: Table, body: BodySpec, cord: CordSpec, f: FabricationSpec) -> None:
    """What one table asks of another."""
    material = top.table("material")
    name = material.data.get("name")
    printed = isinstance(name, str) and name in read_rows("materials.csv") and not silicone(name)
    if f.kind == "cast" and printed:
        material.fail(
            "name",
            f"[fabrication] process {f.process!r} casts silicone, and {name!r} is none; there is:"
            f" {', '.join(read_rows('silicones.csv'))}",
        )
    if body.bay and not f.pockets:
        top.table("fabrication").fail("pockets", "wires to the connector bay begin in pockets")
    if f.pockets and f.wire_diameter >= cord.ferrule_diameter:
        top.table("fabrication").fail(
            "wire_diameter" if top.table("fabrication").has("wire_diameter") else "pockets",
            f"a wire of {f.wire_diameter:g} mm is not thinner than the ferrule of"
            f" {cord.ferrule_diameter:g} mm, which would follow it out of its pocket",
        )


def _stretching(top: Table, cord: CordSpec, f: FabricationSpec) -> None:
    """What pre-stretch asks of the cord and the assembly."""
    if not f.prestretch:
        return
    t = top.table("fabrication")
    if f.assembly == "bonded":
        t.fail("prestretch", 'a bonded cord is glued as it lies; assembly = "held" stretches it')
    if f.prestretch >= cord.max_strain:
        t.fail("prestretch", f"the cord {cord.name!r} takes strains up to {cord.max_strain:g}")


def _body(t: Table, folder: Path, overrides: Mapping[str, Any]) -> BodySpec:
    kinds: tuple[BodyKind, ...] = ("script", "step", "mesh")
    given = [k for k in kinds if t.has(k)]
    if len(given) != 1:
        t.fail(None, f"needs exactly one of script, step, mesh; it has {len(given)}")
    kind = given[0]
    path = folder / t.string(kind)
    if not path.is_file():
        t.fail(kind, f"no such file: {path}")
    parameters = dict(t.table("parameters", required=False).data) if kind == "script" else {}
    if overrides and kind != "script":
        t.fail(kind, "--set changes parameters of a script; this body has none")
    for name, value in overrides.items():
        known = parameters.get(name)
        if is_number(known) and not is_number(value):
            raise DeviceError(
                f"--set {name}={value}: {DEVICE} has the number {known} there; give a number, as in"
                f" {name}={known}"
            )
    parameters.update(overrides)
    for name, value in parameters.items():
        if isinstance(value, int | float) and not isinstance(value, bool) and not is_number(value):
            t.fail("parameters", f"{name} must be a finite number, not {value!r}")
    scale = t.number("scale", 1.0, low=0) if kind == "mesh" else 1.0
    limit = t.number("time_limit", BodySpec.time_limit, low=0)
    fill = t.boolean("fill_cavities", False)
    bay = _bay(t.table("bay")) if t.has("bay") else None
    t.done()
    return BodySpec(kind, path, parameters, scale, bay, limit, fill)


def _bay(t: Table) -> BaySpec:
    at = t.vector("at")
    width, height, depth = t.vector("size", default=BAY).tolist()
    least = "is width, height and depth, each at least 2 mm"
    t.within("size", min(width, height, depth), 2, np.inf, least)
    t.done()
    return BaySpec(at, (width, height, depth))


def _mesh(t: Table) -> MeshSpec:
    edge = t.number("edge_length", low=0) if t.has("edge_length") else None
    accuracy = t.number("accuracy", low=0) if t.has("accuracy") else None
    if edge is None and accuracy is None:
        t.number("edge_length")  # says what is missing or misspelt
    if edge is not None and accuracy is not None:
        t.fail("edge_length", "give either edge_length = 6.0 (mm) or accuracy = 0.01 (of signals)")
    if accuracy is not None:
        low, high = ACCURACIES
        t.within(
            "accuracy", accuracy, low, high, f"must lie between {low} and {high}, not {accuracy:g}"
        )
    limit = t.number("time_limit", MeshSpec.time_limit, low=0)
    t.done()
    return MeshSpec(edge, accuracy, limit)


def _regions(t: Table) -> dict[str, Shape]:
    return {name: _region(t.table(name)) for name in t.data}


def _region(t: Table) -> Shape:
    shapes = ("box", "sphere", "half_space", "cylinder")
    given = [s for s in shapes if t.has(s)]
    if len(given) != 1:
        t.done()
        t.fail(None, f"needs exactly one of {', '.join(shapes)}")
    shape: Shape
    if given[0] == "box":
        inner = t
        shape = Box(*t.array("box", (2, 3)))
    else:
        inner = t.table(given[0])
        if given[0] == "sphere":
            shape = Sphere(inner.vector("center"), inner.number("radius", low=0))
        elif given[0] == "half_space":
            shape = HalfSpace(inner.vector("origin"), inner.vector("normal"))
        else:
            start, end = inner.vector("start"), inner.vector("end")
            shape = Cylinder(start, end, inner.number("radius", low=0))
        inner.done()
    if wrong := flaw(shape):
        inner.fail(*wrong)
    t.done()
    return shape


def _outputs(t: Table, regions: Sequence[str]) -> OutputsSpec:
    value = t.raw("markers", 40)
    anchor = t.string("anchor") if t.has("anchor") else None
    if anchor is not None:
        t.choice("anchor", anchor, regions, "region")
    t.done()
    if value == "surface":
        return OutputsSpec("surface", anchor)
    if isinstance(value, list):
        points = t.array("markers", (None, 3))
        if len(points) == 0:
            t.fail("markers", "give at least one point")
        return OutputsSpec(points, anchor)
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        t.fail("markers", 'must be a number of markers, a list of points, or "surface"')
    return OutputsSpec(value, anchor)


def _fabrication(t: Table) -> FabricationSpec:
    rows = read_rows("printers.csv")
    name = t.string("process", next(iter(rows)))
    t.choice("process", name, list(rows), "process")
    row = rows[name]
    spec = FabricationSpec(
        process=name,
        clearance=t.number("clearance", float(row["clearance"]), low=-1e-9),
        wall=t.number("wall", float(row["wall"]), low=0),
        lead=t.number("lead", 20.0, low=-1e-9),
        bed=_bed(t, row),
        pockets=t.boolean("pockets", True),
        limit_cuts=t.boolean("limit_cuts", False),
        strain_relief=t.boolean("strain_relief") if t.has("strain_relief") else None,
        wire_diameter=t.number("wire_diameter", 1.1, low=0),
        marker_seats=t.count("marker_seats") or 0,
        marker_size=t.number("marker_size", 10.0, low=0),
        assembly=t.string("assembly", ASSEMBLIES[0]),
        prestretch=t.size("prestretch") if t.has("prestretch") else None,
        kind=row["kind"],
        line=t.number("line", float(row["line"]), low=0),
        layer=t.number("layer", float(row["layer"]), low=0),
        hole=t.size("hole", float(row["hole"])),
        spacing=float(row["spacing"]),
        supports=row["supports"],
        copies=t.count("copies", FabricationSpec.copies),
        mould_wall=t.number("mould_wall", FabricationSpec.mould_wall, low=2),
        shrinkage=t.size("shrinkage") if t.has("shrinkage") else None,
    )
    if t.has("copies"):
        most = f"must be at most {MOST_COPIES}, not {spec.copies}"
        t.within("copies", spec.copies, 1, MOST_COPIES, most)
    if spec.shrinkage is not None:
        share = f"is a share of the length, as in 0.002, not {spec.shrinkage:g}"
        t.within("shrinkage", spec.shrinkage, 0, MOST_SHRINKAGE, share)
    if spec.kind == "cast" and spec.limit_cuts:
        t.fail("limit_cuts", "parts that wrap round the end of a cut cannot be cast; remove it")
    for key in ("mould_wall", "shrinkage"):
        if t.has(key) and spec.kind != "cast":
            t.fail(key, f"is for moulds, and process {spec.process!r} prints the parts themselves")
    t.choice("assembly", spec.assembly, ASSEMBLIES, "assembly")
    if max(spec.lead, spec.clearance, spec.wall) > 1000:
        t.fail(None, "clearance, wall and lead are in mm; one is more than 1000")
    t.done()
    return spec


def _bed(t: Table, row: Mapping[str, str]) -> tuple[float, float, float]:
    """The bed that is stated, or that of the process, mm."""
    of_process = [float(row[f"bed_{axis}"]) for axis in "xyz"]
    bed, (low, high) = t.vector("bed", default=of_process), BEDS
    what = "is width, depth and height of what the printer makes"
    t.within("bed", bed, low, high, f"{what}, {low:g} to {high:g} mm each")
    x, y, z = bed.tolist()
    return x, y, z


def _sensors(top: Table) -> tuple[Sensor, ...]:
    sensors: list[Sensor] = []
    for t in top.tables("sensors"):
        name = t.string("name")
        if name in [s.name for s in sensors]:
            t.fail("name", f"{name!r} is used already; choose another name")
        p = t.table("plane")
        origin, normal, x_axis = p.vector("origin"), p.vector("normal"), p.vector("x_axis")
        p.done()
        points = t.array("control_points", (None, 2))
        if len(points) < 4:
            t.fail("control_points", "needs at least 4: the first and last two are the ends")
        if (np.linalg.norm(np.diff(points, axis=0), axis=1) < 1e-6).any():
            t.fail("control_points", "two neighbours coincide; move or remove one")
        tangents = (
            t.array("tangents", (len(points), 2)) if t.has("tangents") else catmull_rom(points)
        )
        if (np.linalg.norm(tangents, axis=1) < 1e-6).any():
            t.fail("tangents", "a tangent is zero; give it a direction")
        free = t.strings("free", [])
        for word in free:
            t.choice("free", word, FREEDOMS, "freedom")
        if {"plane", "offset"} <= set(free):
            t.fail("free", "a plane that is free may shift, too; leave out either plane or offset")
        t.done()
        try:
            plane = Plane.from_normal(origin, normal, x_axis)
        except ValueError as error:
            p.fail(None, str(error))
        sensors.append(Sensor(name, plane, Hermite(points, tangents), frozenset(free)))
    return tuple(sensors)
