"""A first device.toml for a body that is held at one end and moved at the other."""

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
from .defaults import DEFAULT_CORD, DEFAULT_CORDS, DEFAULT_PROCESS, MAX_CORDS
from .dropped_body import TETS_PER_CUBE, DroppedBody, check_unit
from .starting_devices import write_device
from .units import UNIT_WORDS, UNITS, unknown_unit

MODES = "modes"
MAX_TETS = 1_000_000  # that can be solved
#: Materials of processes, by the start of the process's name.
_MATERIALS = {
    "fdm-tpu": "ninjaflex-85a", "polyjet-agilus": "agilus30-black", "polyjet": "tango-black-plus",
    "sla-elastic": "formlabs-elastic-50a", "sla-flexible": "formlabs-flexible-80a",
    "sls-tpu": "eos-tpu-1301", "cast-silicone": "dragon-skin-20",
}  # fmt: skip


def default_material(process: str) -> str:
    """Return the material in materials.csv that a process in printers.csv prints.

    Raises:
        DeviceError: The process is user-defined (`material-unknown`).
    """
    for start, material in _MATERIALS.items():
        if process.startswith(start):
            return material
    raise DeviceError(
        f"the material of the process {process} is not known",
        code="material-unknown",
        where="process",
        action="Give a material",
        process=process,
    )


@dataclass(frozen=True)
class FirstDevice:
    """Choices for a first device, other than its body.

    Attributes:
        name: Name of the device.
        unit: Unit of the body's file.
        material: Name of the material.
        edge_length: Edge length of the mesh, mm.
        poses: Names of END_POSES, only MODES, or none yet.
        cord: Name of the cord.
        process: Name of the printing process.
        cords: Number of cords to find; 0 for none yet; None for as many as there are poses, so that
            they can be distinguished, but at least three.

    Raises:
        DeviceError: A choice is invalid.
    """

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
            raise unknown_unit(self.unit)
        if self.cords is not None and not 0 <= self.cords <= MAX_CORDS:
            raise DeviceError(
                f"must be 1 to {MAX_CORDS}, not {self.cords}",
                code="out-of-range",
                where="cords",
                value=self.cords,
            )
        if self.poses:
            check_poses(self.poses)

    def cords_for(self, poses: int) -> int:
        """Return the number of cords to find for a number of poses."""
        return max(DEFAULT_CORDS, poses) if self.cords is None else self.cords


def check_poses(names: tuple[str, ...]) -> None:
    """Check names of poses.

    Raises:
        DeviceError: They are neither only MODES, nor different names of END_POSES (`unknown-pose`).
    """
    is_known = names == (MODES,) or (names and set(names) <= set(END_POSES))
    if not is_known or len(set(names)) < len(names):
        raise DeviceError(
            f"{','.join(names)} are not valid poses",
            code="unknown-pose",
            where="poses",
            action=f"Use {MODES}, or some of {', '.join(END_POSES)} with commas, each once",
            poses=names,
        )


def create_first_device(
    dropped: DroppedBody, folder: Path, first: FirstDevice, progress: Progress = silent
) -> tuple[str, ...]:
    """Write a body and its device.toml to a folder. After an error nothing is left in it.

    Args:
        dropped: The body.
        folder: The folder, which is created if needed.
        first: Choices for the device.
        progress: Called with the progress.

    Returns:
        The names of the poses.

    Raises:
        BodyError: The body has an impossible size, or no room for a cord.
        DeviceError: The device is invalid.
        StorageError: The folder has a device already, or cannot be written.
    """
    check_unit(dropped, first.unit)
    check_edge_length(dropped, first.unit, first.edge_length)
    if first.cords_for(len(first.poses)):
        check_room(dropped, first.unit, first.cord, first.process)
    file = _free_name(dropped, folder)
    files = {file: dropped.content, **dropped.others}
    text = device_text(dropped, file, first)
    with tempfile.TemporaryDirectory(
        prefix="defsense-"
    ) as other:  # check that it is a valid device
        trial = Path(other)
        for name, content in files.items():
            (trial / name).parent.mkdir(parents=True, exist_ok=True)
            (trial / name).write_bytes(content)
        if first.poses == (MODES,):
            text = _add_modes(text, first, trial, progress)
            if (trial / MESH_LOCK).exists():
                files[MESH_LOCK] = (trial / MESH_LOCK).read_bytes()
        complete = bool(first.poses and first.cords_for(len(first.poses)))
        device = parse_device(text, trial, complete)
        if first.poses and "states" not in tomlkit.parse(text):
            text = _add_states(text, device.states)
    write_device(folder, files, commented(text, DeviceFile))
    return tuple(p.name for p in device.poses)


def check_room(dropped: DroppedBody, unit: str, cord: str, process: str) -> None:
    """Check that a body is thick enough for a cord and its walls, and long enough to stretch it.

    User-defined processes and cords are not checked.

    Raises:
        BodyError: There is no room for the cord (`no-room-for-cord`).
    """
    printers, cords = read_rows("printers.csv"), read_rows("cords.csv")
    if process not in printers or cord not in cords:
        return
    size, printer = dropped.size(unit), printers[process]
    reasons = {name: _missing_room(size, row, printer) for name, row in cords.items()}
    if reason := reasons[cord]:
        fitting = [name for name, other in reasons.items() if not other]
        remedy = f"Choose {' or '.join(fitting)}" if fitting else "Make the body larger"
        raise BodyError(
            reason.format(cord),
            code="no-room-for-cord",
            where=dropped.name,
            action=f"{remedy}, or check its unit ({UNIT_WORDS[unit]})",
            cord=cord,
            fitting=tuple(fitting),
        )


def _missing_room(size: Float, cord: Mapping[str, str], printer: Mapping[str, str]) -> str:
    """Return why a body of extents (3,) mm has no room for a cord; empty if it has room."""
    row = {k: float(cord[k]) for k in ("diameter", "min_stretch", "ferrule_length")}
    min_thickness = row["diameter"] + 2 * sum(float(printer[k]) for k in ("wall", "clearance"))
    min_length = row["min_stretch"] + 2 * row["ferrule_length"]
    thickness, diagonal = float(size.min()), float(np.linalg.norm(size))
    if thickness < min_thickness:
        return (
            f"is {thickness:.3g} mm thick; the cord {{}} with its walls needs"
            f" {min_thickness:.2g} mm"
        )
    if diagonal < min_length:
        return (
            f"is {diagonal:.3g} mm from corner to corner; the cord {{}} needs at least"
            f" {min_length:.3g} mm with its two ends"
        )
    return ""


def check_edge_length(dropped: DroppedBody, unit: str, edge_length: float) -> None:
    """Check the edge length of a mesh, mm.

    Raises:
        DeviceError: It is larger than the body is thick, or gives too many elements
            (`out-of-range`).
    """
    largest = float(dropped.size(unit).min())
    smallest = float(np.cbrt(TETS_PER_CUBE * dropped.in_mm(unit).volume / MAX_TETS))
    if not smallest <= edge_length <= largest:
        raise DeviceError(
            f"must be from {smallest:.2g} mm (a million elements) to {largest:.3g} mm (the"
            f" thickness of the body), not {edge_length:g} mm",
            code="out-of-range",
            where="edge length",
            action=f"The default for this body is {dropped.edge_length(unit):g} mm",
            value=edge_length,
        )


def device_text(dropped: DroppedBody, file: str, first: FirstDevice) -> str:
    """Return a first device.toml, without comments and [states]."""
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


def _free_name(dropped: DroppedBody, folder: Path) -> str:
    """Return a free file name, or that of an identical file in the folder."""
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


def _add_modes(text: str, first: FirstDevice, trial: Path, progress: Progress) -> str:
    """Add poses by natural modes, and the number of cords for them.

    Raises:
        DeviceError: No mode can be a pose (`no-mode-is-pose`).
    """
    from ..study.propose_poses import as_toml, extend_text, find_poses

    write_text(trial / DEVICE, text)
    found = find_poses(load_device(trial, complete=False), "base", progress=progress)
    if not found.poses:
        kinds = ", ".join(sorted({f"{m.kind} of order {m.order}" for m in found.modes}))
        raise DeviceError(
            f"none of the lowest modes of the body moves its far end as a whole (they are {kinds})",
            code="no-mode-is-pose",
            where="poses modes",
            action="Use the poses bend,twist instead",
        )
    if first.cords is None:
        document: Any = tomlkit.parse(text)
        document["design"]["sensors"] = first.cords_for(len(found.poses))
        text = tomlkit.dumps(document)
    return extend_text(text, as_toml(list(found.poses), "base", found.region))


def _add_states(text: str, states: Any) -> str:
    from ..study.propose_poses import states_table

    document = tomlkit.document()
    document["states"] = states_table(states)
    return text.rstrip("\n") + "\n\n" + tomlkit.dumps(document)


def _nested(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _inline(v) if isinstance(v, dict) else v for k, v in values.items()}


def _inline(values: Mapping[str, Any]) -> Any:
    table = tomlkit.inline_table()
    table.update(values)
    return table
