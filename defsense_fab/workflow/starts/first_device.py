"""A first device.toml for a body that is held at one end and moved at the other."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from ...core.arrays import Float
from ...core.device.device import Device, MaterialSpec
from ...core.device.device_file import DEVICE, DeviceFile, load_device, parse_device
from ...core.device.material_table import MaterialTable
from ...core.device.materials import default_material, is_makeable, list_processes
from ...core.errors import BodyError, DeviceError
from ...core.progress import Progress, silent
from ...core.schema.reference import commented
from ...core.schema.types import exact
from ...core.storage.files import storage_errors, unused_path, write_text
from ...core.storage.package_data import read_rows
from ...geometry.bodies.meshing.mesh_store import DEVICE_MESH
from .body_ends import BodyEnds, find_ends, round_numbers
from .body_file import TETS_PER_CUBE, BodyFile, choose_unit, scale_to_size
from .options import (
    DEFAULT_CORD,
    DEFAULT_PROCESS,
    MIN_DEFAULT_CORDS,
    MODES,
    UNIT_WORDS,
    NewOptions,
)
from .reachable_poses import reachable_share
from .starting_devices import write_device

MAX_SOLVABLE_TETS = 1_000_000  # that can be solved


def fill_options(body: BodyFile, options: NewOptions) -> NewOptions:
    """Return options in which defaults that fit the body replace missing values.

    The body has its size already, so that the options have a unit and no size. Only `cords` may
    still be None, since their number follows from that of the poses. Without a name, the device has
    the name of the body.

    Args:
        body: The body.
        options: Choices of the user.

    Raises:
        DeviceError: A choice does not fit the body, or its unit is doubtful.
        BodyError: The body has an impossible size.
    """
    unit = choose_unit(body, options.units)
    edge_length = options.edge_length
    if edge_length is None:
        edge_length = body.edge_length(unit)
    check_edge_length(body, unit, edge_length)
    process = options.process or DEFAULT_PROCESS
    if options.process is None and not is_makeable(options.material or "", process):
        process = list_processes(str(options.material))[0]
    return replace(
        options,
        name=options.name or body.name,
        units=unit,
        size=None,
        material=options.material or default_material(process),
        edge_length=edge_length,
        poses=options.poses or find_ends(body.in_mm(unit)).default_poses(),
        cord=options.cord or DEFAULT_CORD,
        process=process,
    )


def create_first_device(
    body: BodyFile,
    folder: Path,
    options: NewOptions,
    progress: Progress = silent,
    *,
    is_draft: bool = False,
) -> Device:
    """Write a body and its device.toml to a folder. After an error nothing is left in it.

    Args:
        body: The body.
        folder: The folder, which is created if needed.
        options: Choices for the device.
        progress: Called with the progress.
        is_draft: Whether poses and cords are left to be added later.

    Returns:
        The device.

    Raises:
        BodyError: The body has an impossible size, or no room for a cord.
        DeviceError: The device is invalid.
        StorageError: The folder has a device already, or cannot be written.
    """
    body = scale_to_size(body, options.size)
    options = fill_options(body, options)
    if not is_draft:
        check_room(body, str(options.units), str(options.cord), str(options.process))
    file = _free_name(body, folder)
    files = {file: body.content, **body.others}
    text = _device_text(body, file, options, is_draft)
    # Check that the device is valid before anything is written to the folder.
    with tempfile.TemporaryDirectory(prefix="defsense-") as other:
        trial = Path(other)
        for name, content in files.items():
            (trial / name).parent.mkdir(parents=True, exist_ok=True)
            (trial / name).write_bytes(content)
        if options.poses == (MODES,) and not is_draft:
            text = _add_modes(text, options, trial, progress)
            if (trial / DEVICE_MESH).exists():
                files[DEVICE_MESH] = (trial / DEVICE_MESH).read_bytes()
        device = parse_device(text, trial, complete=not is_draft)
        if not is_draft and "states" not in tomlkit.parse(text):
            text = _add_states(text, device.states)
    write_device(folder, files, commented(text, DeviceFile))
    return load_device(folder, complete=not is_draft)


def check_room(body: BodyFile, unit: str, cord: str, process: str) -> None:
    """Check that a body is thick enough for a cord and its walls, and long enough to stretch it.

    Raises:
        BodyError: There is no room for the cord (`no-room-for-cord`).
    """
    printer, cords = read_rows("printers.csv")[process], read_rows("cords.csv")
    size = body.size(unit)
    reasons = {name: _missing_room(size, row, printer) for name, row in cords.items()}
    if reason := reasons[cord]:
        fitting = [name for name, other in reasons.items() if not other]
        check = "size" if body.factor != 1 else f"unit ({UNIT_WORDS[unit]})"
        remedy = f"Choose {' or '.join(fitting)}" if fitting else "Make the body thicker or longer"
        raise BodyError(
            reason.format(cord),
            code="no-room-for-cord",
            where=body.name,
            action=f"{remedy}, or check its {check}",
            cord=cord,
            fitting=tuple(fitting),
        )


def first_fitting_cord(body: BodyFile, unit: str, process: str) -> str:
    """Return the first cord of the table that fits a body.

    Raises:
        BodyError: No cord does (`no-room-for-cord`).
    """
    for cord in read_rows("cords.csv"):
        with suppress(BodyError):
            check_room(body, unit, cord, process)
            return cord
    check_room(body, unit, DEFAULT_CORD, process)
    return DEFAULT_CORD


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


def edge_length_range(body: BodyFile, unit: str) -> tuple[float, float]:
    """Return the smallest edge length (mm) that can be computed, and the body's thickness (mm)."""
    smallest = float(np.cbrt(TETS_PER_CUBE * body.in_mm(unit).volume / MAX_SOLVABLE_TETS))
    return smallest, float(body.size(unit).min())


def check_edge_length(body: BodyFile, unit: str, edge_length: float) -> None:
    """Check the edge length of a mesh, mm.

    Raises:
        DeviceError: It is larger than the body is thick, or gives too many elements
            (`out-of-range`).
    """
    smallest, largest = edge_length_range(body, unit)
    if not smallest <= edge_length <= largest:
        raise DeviceError(
            f"must be from {smallest:.2g} mm (a million elements) to {largest:.3g} mm (the"
            f" thickness of the body), not {exact(edge_length)} mm",
            code="out-of-range",
            where="edge_length",
            key="mesh.edge_length",
            action=f"The default for this body is {body.edge_length(unit):g} mm",
            value=edge_length,
        )


def _device_text(body: BodyFile, file: str, options: NewOptions, is_draft: bool) -> str:
    """Return a first device.toml, without comments and [states]."""
    unit, edge_length = str(options.units), float(options.edge_length or 0)
    ends = find_ends(body.in_mm(unit))
    names = ("base",) if options.poses == (MODES,) and not is_draft else ("base", "tip")
    regions = {name: _inline(_nested(ends.region(name, edge_length))) for name in names}
    document = tomlkit.document()
    document.update({"schema": 1, "name": options.name})
    tables: dict[str, Any] = {
        "body": _nested(body.table(file, unit)),
        "material": {"name": options.material},
        "mesh": {"edge_length": round_numbers([edge_length])[0]},
        "regions": regions,
        "outputs": {"markers": 40, "anchor": "base"},
        "cord": {"name": options.cord},
        "fabrication": {"process": options.process},
    }
    if not is_draft:
        tables["design"] = {"sensors": _count_cords(options, len(options.poses))}
    for name, values in tables.items():
        document.add(tomlkit.nl())
        table = tomlkit.table()
        table.update(values)
        document.add(name, table)
    if not is_draft and options.poses != (MODES,):
        document.add(tomlkit.nl())
        material = MaterialTable(name=str(options.material)).record()
        document.add("poses", _poses(ends, options.poses, material))
    return tomlkit.dumps(document)


def _count_cords(options: NewOptions, poses: int) -> int:
    """Return the number of cords: as many as poses, so that these can be distinguished."""
    return max(MIN_DEFAULT_CORDS, poses) if options.cords is None else options.cords


def _free_name(body: BodyFile, folder: Path) -> str:
    """Return a free file name, or that of an identical file in the folder."""
    path = folder / f"{body.name}{body.suffix}"
    with storage_errors(path):
        if path.is_file() and path.read_bytes() == body.content:
            return path.name
    return unused_path(path).name


def _poses(ends: BodyEnds, names: tuple[str, ...], material: MaterialSpec) -> Any:
    poses = tomlkit.aot()
    for name in names:
        handle, handles, pose = tomlkit.table(), tomlkit.aot(), tomlkit.table()
        share = reachable_share(ends, name, material)
        handle.update({"region": "tip", **_nested(ends.move(name, share))})
        handles.append(handle)
        pose.update({"name": name, "fixed": ["base"], "handles": handles})
        poses.append(pose)
    return poses


def _add_modes(text: str, options: NewOptions, trial: Path, progress: Progress) -> str:
    """Add poses by natural modes, and the number of cords for them.

    Raises:
        DeviceError: No mode can be a pose (`no-mode-is-pose`).
    """
    from ..study.options import ModesOptions
    from ..study.propose_poses import as_toml, extend_text, find_poses

    write_text(trial / DEVICE, text)
    device = load_device(trial, complete=False)
    search = find_poses(device, ModesOptions(fixed="base"), progress)
    if not search.poses:
        kinds = ", ".join(sorted({f"{m.kind} of order {m.order}" for m in search.modes}))
        raise DeviceError(
            f"none of the lowest modes of the body moves its far end as a whole (they are {kinds})",
            code="no-mode-is-pose",
            where="poses",
            action="Use the poses bend,twist instead",
        )
    document: Any = tomlkit.parse(text)
    document["design"]["sensors"] = _count_cords(options, len(search.poses))
    text = tomlkit.dumps(document)
    return extend_text(text, as_toml(list(search.poses), "base", search.region))


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
