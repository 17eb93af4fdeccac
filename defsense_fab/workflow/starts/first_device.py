"""A first device.toml for a body: held at one end, moved at the other, by what was chosen."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from ...core.arrays import Float
from ...core.device.device_file import DEVICE, DeviceFile, load_device, parse_device
from ...core.errors import BodyError, DeviceError
from ...core.progress import Progress, silent
from ...core.schema.reference import commented
from ...core.storage.files import storage_errors, unused_path, write_text
from ...core.storage.package_data import read_rows
from ...geometry.bodies.meshing.mesh_lock import FILE as MESH_LOCK
from .body_ends import END_POSES, BodyEnds, find_ends, round_numbers
from .dropped_body import check_unit
from .dropped_body import TETS_PER_CUBE, DroppedBody
from .starting_devices import write_device
from .units import UNIT_WORDS, UNITS
from .defaults import DEFAULT_CORD, DEFAULT_CORDS, MAX_CORDS, DEFAULT_PROCESS

MODES = "modes"
_MOST_TETS = 1_000_000
#: A material that each kind of process makes; the first whose name begins so.
_MATERIALS = {
    "fdm-tpu": "ninjaflex-85a", "polyjet-agilus": "agilus30-black", "polyjet": "tango-black-plus",
    "sla-elastic": "formlabs-elastic-50a", "sla-flexible": "formlabs-flexible-80a",
    "sls-tpu": "eos-tpu-1301", "cast-silicone": "dragon-skin-20",
}  # fmt: skip


def default_material(process: str) -> str:
    """A row of materials.csv that is made by this row of printers.csv. Raises DeviceError for a row
    of one's own."""
    for start, material in _MATERIALS.items():
        if process.startswith(start):
            return material
    raise DeviceError(f"process {process}: say which material it prints, as --material NAME")


@dataclass(frozen=True)
class FirstDevice:
    """What is chosen of a device besides its body: the `unit` of the body's file; `poses`, names of
    END_POSES, only MODES, or none yet; how many `cords` are to be found, none yet being 0, and None
    as many as there are poses, which is what tells these apart, but three at least."""

    name: str
    unit: str
    material: str
    edge_length: float
    poses: tuple[str, ...] = ()
    cord: str = DEFAULT_CORD
    process: str = DEFAULT_PROCESS
    cords: int | None = 0

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise DeviceError(f"units {self.unit!r}: there is {', '.join(UNITS)}")
        if self.cords is not None and not 0 <= self.cords <= MAX_CORDS:
            raise DeviceError(f"cords {self.cords}: give a number from 1 to {MOST_CORDS}")
        if self.poses:
            check_poses(self.poses)

    def cords_for(self, poses: int) -> int:
        """How many are to be found where there are so many poses."""
        return max(DEFAULT_CORDS, poses) if self.cords is None else self.cords


def check_poses(names: tuple[str, ...]) -> None:
    """Raises DeviceError for other than only MODES, or names of END_POSES, each once."""
    known = names == (MODES,) or (names and set(names) <= set(END_POSES))
    if not known or len(set(names)) < len(names):
        raise DeviceError(
            f"poses {','.join(names)}: write {MODES}, or some of {', '.join(END_POSES)} with"
            " commas, each once"
        )


def create_first_device(
    dropped: DroppedBody, folder: Path, first: FirstDevice, progress: Progress = silent
) -> tuple[str, ...]:
    """Write the body and its device.toml into a folder, which may not be there yet; returns the
    names of its poses. Raises BodyError for a body of impossible size, DeviceError for a device
    that can be none, StorageError where there is a device, or the folder cannot be written: nothing
    is then left in it."""
    check_unit(dropped, first.unit)
    check_edge_length(dropped, first.unit, first.edge_length)
    if first.cords_for(len(first.poses)):
        check_room(dropped, first.unit, first.cord, first.process)
    file = _own_name(dropped, folder)
    files = {file: dropped.content, **dropped.others}
    text = device_text(dropped, file, first)
    with tempfile.TemporaryDirectory(prefix="defsense-") as other:  # is it a device?
        trial = Path(other)
        for name, content in files.items():
            (trial / name).parent.mkdir(parents=True, exist_ok=True)
            (trial / name).write_bytes(content)
        if first.poses == (MODES,):
            text = _with_modes(text, first, trial, progress)
            if (trial / MESH_LOCK).exists():
                files[MESH_LOCK] = (trial / MESH_LOCK).read_bytes()
        complete = bool(first.poses and first.cords_for(len(first.poses)))
        device = parse_device(text, trial, complete)
        if first.poses and "states" not in tomlkit.parse(text):
            text = _with_states(text, device.states)
    write_device(folder, files, commented(text, DeviceFile))
    return tuple(p.name for p in device.poses)


def check_room(dropped: DroppedBody, unit: str, cord: str, process: str) -> None:
    """Raises BodyError for a body that is too thin for a cord and its walls, or too short for a
    cord that stretches between its two ends."""
    printers, cords = read_rows("printers.csv"), read_rows("cords.csv")
    if process not in printers or cord not in cords:
        return
    size, printer = dropped.size(unit), printers[process]
    lacks = {name: _lacks(size, row, printer) for name, row in cords.items()}
    if why := lacks[cord]:
        fitting = [name for name, lack in lacks.items() if not lack]
        remedy = f"take {' or '.join(fitting)}" if fitting else "make the body larger"
        raise BodyError(
            f"{dropped.name}: {why.format(cord)}: {remedy}, or check its unit ({UNIT_WORDS[unit]})"
        )


def _lacks(size: Float, cord: Mapping[str, str], printer: Mapping[str, str]) -> str:
    """Why a body of these extents (3,) mm has no room for a cord, or nothing."""
    row = {k: float(cord[k]) for k in ("diameter", "min_stretch", "ferrule_length")}
    wide = row["diameter"] + 2 * sum(float(printer[k]) for k in ("wall", "clearance"))
    least = row["min_stretch"] + 2 * row["ferrule_length"]
    thick, long = float(size.min()), float(np.linalg.norm(size))
    if thick < wide:
        return f"is {thick:.3g} mm thin; the cord {{}} with its walls takes {wide:.2g} mm"
    if long < least:
        return (
            f"is {long:.3g} mm from corner to corner; the cord {{}} takes at least {least:.3g} mm"
            " with its two ends"
        )
    return ""


def check_edge_length(dropped: DroppedBody, unit: str, edge_length: float) -> None:
    """Raises DeviceError for elements that are no length, larger than the body is thick, or more
    than can be solved."""
    thick = float(dropped.size(unit).min())
    least = float(np.cbrt(TETS_PER_CUBE * dropped.in_mm(unit).volume / _MOST_TETS))
    if not least <= edge_length <= thick:
        raise DeviceError(
            f"edge length {edge_length:g} mm: give one from {least:.2g} mm (a million elements) to"
            f" {thick:.3g} mm (the body's thickness); fitted to this body it is"
            f" {dropped.edge_length(unit):g} mm"
        )


def device_text(dropped: DroppedBody, file: str, first: FirstDevice) -> str:
    """device.toml as a person would begin it, without comments and [states]."""
    surface = dropped.in_mm(first.unit)
    ends = find_ends(surface)
    document = tomlkit.document()
    document.update({"schema": 1, "name": first.name})
    tables: dict[str, Any] = {
        "body": _nested(dropped.table(file, first.unit)),
        "material": {"name": first.material},
        "mesh": {"edge_length": round_numbers([first.edge_length])[0]},
        "regions": _regions(ends, first),
        "outputs": {"markers": 40, "anchor": "base"},
        "cord": {"name": first.cord},
        "fabrication": {"process": first.process},
    }
    if cords := first.cords_for(len(first.poses)):
        tables["design"] = {"sensors": cords}
    for name, values in tables.items():
        document.add(tomlkit.nl())
        table = tomlkit.table()
        table.update(values)
        document.add(name, table)
    if first.poses and first.poses != (MODES,):
        document.add(tomlkit.nl())
        document.add("poses", _poses(ends, first.poses))
    return tomlkit.dumps(document)


def _own_name(dropped: DroppedBody, folder: Path) -> str:
    """A free one, or that of the same file where it lies in the folder already."""
    path = folder / f"{dropped.name}{dropped.suffix}"
    with storage_errors(path):
        if path.is_file() and path.read_bytes() == dropped.content:
            return path.name
    return unused_path(path).name


def _regions(ends: BodyEnds, first: FirstDevice) -> dict[str, Any]:
    names = ("base",) if first.poses == (MODES,) else ("base", "tip")
    return {n: _inline(_nested(ends.region(n, first.edge_length))) for n in names}


def _poses(ends: BodyEnds, names: tuple[str, ...]) -> Any:
    poses = tomlkit.aot()
    for name in names:
        handle, handles, pose = tomlkit.table(), tomlkit.aot(), tomlkit.table()
        handle.update({"region": "tip", **_nested(ends.move(name))})
        handles.append(handle)
        pose.update({"name": name, "fixed": ["base"], "handles": handles})
        poses.append(pose)
    return poses


def _with_modes(text: str, first: FirstDevice, trial: Path, progress: Progress) -> str:
    """The device's text with its poses by natural modes, and cords for these. Raises DeviceError
    where there is none."""
    from ..study.propose_poses import as_toml, continued, find_poses

    write_text(trial / DEVICE, text)
    found = find_poses(load_device(trial, complete=False), "base", progress=progress)
    if not found.poses:
        kinds = ", ".join(sorted({f"{m.kind} of order {m.order}" for m in found.modes}))
        raise DeviceError(
            "poses modes: none of the body's lowest modes leads its far end as a whole (they are"
            f" {kinds}); give --poses bend,twist in their place"
        )
    if first.cords is None:
        document: Any = tomlkit.parse(text)
        document["design"]["sensors"] = first.cords_for(len(found.poses))
        text = tomlkit.dumps(document)
    return continued(text, as_toml(list(found.poses), "base", found.region))


def _with_states(text: str, states: Any) -> str:
    from ..study.propose_poses import states_table

    document = tomlkit.document()
    document["states"] = states_table(states)
    return text.rstrip("\n") + "\n\n" + tomlkit.dumps(document)


def _nested(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _inline(v) if isinstance(v, dict) else v for k, v in values.items()}


def _inline(values: Mapping[str, Any]) -> Any:
    out = tomlkit.inline_table()
    out.update(values)
    return out
