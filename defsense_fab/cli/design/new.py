"""The command `defsense new`."""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import BodyError, DeviceError, StorageError
from ...workflow.starts.defaults import DEFAULT_CORD, DEFAULT_CORDS, DEFAULT_PROCESS, MAX_CORDS
from ..options import add_verbose_option
from ..output import print_json, print_lines, progress_bars, silent_stdout, standard_output

if TYPE_CHECKING:
    from ...workflow.starts.dropped_body import DroppedBody
    from ..options import Commands


def add(commands: Commands) -> None:
    """`new`."""
    sub = commands.add_parser(
        "new",
        help="Create a device folder with a device.toml that can be built",
        description="Create a device from an example of the package or from a body file. In a "
        "terminal, missing values are requested; press Enter to accept the default in "
        "brackets.",
        examples=[
            "defsense new my-device",
            "defsense new wand --body wand.step --poses bend,twist",
            "defsense new bunny --body bunny.stl --units mm --poses modes --cord rubber-1.7mm",
        ],
    )
    sub.add_argument("folder", type=Path, metavar="DIR", help="Folder to create")
    sub.add_argument(
        "--body",
        metavar="WHAT",
        help="Set the body: bar, twist-bar, cube, blob, or a file (script .py, STEP, or mesh)",
    )
    sub.add_argument(
        "--units",
        metavar="UNIT",
        help="Set the unit of a mesh's lengths: mm, cm, m, inch or um (micrometers)",
    )
    sub.add_argument(
        "--poses",
        metavar="NAMES",
        help="Set the poses: modes (found from the body's natural modes), or some of bend, "
        "bend_side, twist and pull, separated by commas",
    )
    sub.add_argument(
        "--cord",
        metavar="NAME",
        help=f"Set the cord, a row of data/cords.csv (default: {DEFAULT_CORD})",
    )
    sub.add_argument(
        "--cords",
        type=int,
        metavar="N",
        help=f"Set the number of cords to place (default: one per pose, at least {DEFAULT_CORDS})",
    )
    sub.add_argument("--name", help="Set the name of the device (default: name of the folder)")
    sub.add_argument(
        "--process",
        metavar="NAME",
        help="Set the fabrication process, a row of data/printers.csv (default: "
        f"{DEFAULT_PROCESS})",
    )
    sub.add_argument(
        "--material",
        metavar="NAME",
        help="Set the material, a row of data/materials.csv (default: the process's)",
    )
    sub.add_argument(
        "--edge-length",
        type=float,
        metavar="MM",
        help="Set the edge length of the mesh in mm (default: fitted to the body)",
    )
    sub.add_argument(
        "--json", action="store_true", help="Ask no questions, and print the result as JSON"
    )
    add_verbose_option(sub)
    sub.set_defaults(run=_new)


def _new(options: argparse.Namespace) -> int:
    from ...core.device.device_file import DEVICE
    from ...core.storage.file_names import check_folder_name
    from ...workflow.starts.starting_devices import STARTING_DEVICES

    folder: Path = options.folder
    check_folder_name(folder)
    if options.name is not None and not (options.name.strip() and options.name.isprintable()):
        raise DeviceError(f"--name {options.name!r}: give one line of letters")
    if folder.exists() and not folder.is_dir():
        raise StorageError(f"{folder}: is a file; choose another name for the folder")
    if (folder / DEVICE).exists():
        raise StorageError(
            f"{folder / DEVICE}: there is a device already, and it stays as it is; choose another"
            " folder"
        )
    asked = sys.stdin.isatty() and not options.json
    if not asked and options.body is None:
        names = ", ".join(start.name for start in STARTING_DEVICES)
        raise DeviceError(f"--body: give one of {names}, or the file of a body")
    found = _body(options)
    begun = _from_file(found, options, asked) if found else _from_start(options, asked)
    _tell(begun, options)
    return 0


def _body(options: argparse.Namespace) -> DroppedBody | None:
    """The body of a file; None where `options.body` names a device of the package."""
    from ...workflow.starts.dropped_body import load_body_file
    from ...workflow.starts.starting_devices import STARTING_DEVICES
    from .new_questions import answered, ask_body

    starts = {start.name for start in STARTING_DEVICES}

    def look(word: str) -> tuple[str, DroppedBody | None]:
        if word in starts:
            return word, None
        if not word.strip("'\" "):
            raise DeviceError(
                f"--body: give one of {', '.join(s.name for s in STARTING_DEVICES)}, or a file"
            )
        path = _path(word)
        if not path.exists() and not path.suffix:
            raise DeviceError(
                f"{word}: is no file, and none of {', '.join(s.name for s in STARTING_DEVICES)}"
            )
        with silent_stdout():
            return word, load_body_file(path)

    if options.body is not None:
        return look(options.body)[1]
    options.body, found = answered(ask_body, look)
    return found


def _path(word: str) -> Path:
    """A file as it was typed, or as terminals paste one that is dropped on them."""
    bare = word.strip("'\"")
    forms = [word, bare]
    if os.name != "nt":
        with contextlib.suppress(ValueError):  # no closing quotation
            forms += shlex.split(word)[:1]
    paths = [Path(form).expanduser() for form in forms]
    return next((p for p in paths if p.exists()), Path(bare).expanduser())


def _from_start(options: argparse.Namespace, asked: bool) -> dict[str, Any]:
    """A device of the package, with its own body and poses."""
    from ...core.device.device_file import load_device
    from ...workflow.starts.first_device import default_material
    from ...workflow.starts.starting_devices import STARTING_DEVICES, create_starting_device
    from .new_questions import answered, ask_cord, cord_row

    for name in ("units", "poses", "cords", "process", "material", "edge_length"):
        if getattr(options, name) is not None:
            raise DeviceError(
                f"--{name.replace('_', '-')}: {options.body} comes with its own; leave the option"
                " out and change device.toml afterwards"
            )
    start = next(s for s in STARTING_DEVICES if s.name == options.body)
    cord = options.cord
    if cord is None and asked:
        cord = answered(lambda: ask_cord(start.cord), cord_row)
    create_starting_device(start, options.folder, _name(options), cord and cord_row(cord))
    device = load_device(options.folder)
    material, printed = device.material.name, default_material(device.fabrication.process)
    note = (
        f"the example's body is computed as {material}; write what you print, such as {printed},"
        " under [material] before you build"
    )
    return {
        "device": str(options.folder), "name": device.name, "body": device.body.path.name,
        "poses": [p.name for p in device.poses], "cord": device.cord.name,
        "cords": len(device.sensors) + device.propose, "material": material,
        "process": device.fabrication.process,
        "note": "" if material == printed else note,
    }  # fmt: skip


def _from_file(found: DroppedBody, options: argparse.Namespace, asked: bool) -> dict[str, Any]:
    """A device from a body of one's own."""
    from ...core.device.device_file import load_device
    from ...workflow.starts.body_ends import find_ends
    from ...workflow.starts.dropped_body import check_unit, choose_unit
    from ...workflow.starts.first_device import (
        FirstDevice,
        check_edge_length,
        create_first_device,
        default_material,
    )
    from ...workflow.starts.units import describe_unusual_size, parse_unit
    from .new_questions import answered, ask_poses, ask_unit, material_row, pose_names, process_row

    process = process_row(DEFAULT_PROCESS if options.process is None else options.process)
    named = options.material
    material = default_material(process) if named is None else material_row(named)
    cords, edge = options.cords, options.edge_length
    if cords is not None and not 1 <= cords <= MAX_CORDS:  # none: devices that are drawn on
        raise DeviceError(f"--cords {cords}: give a number from 1 to {MAX_CORDS}")

    def checked(text: str) -> str:
        unit = parse_unit(text)
        check_unit(found, unit)
        _usual_cord(found, unit, process)
        return unit

    ask = (lambda: answered(lambda: ask_unit(found), checked)) if asked else None
    unit = choose_unit(found, options.units, ask)
    if edge is not None:
        check_edge_length(found, unit, edge)
    usual = find_ends(found.in_mm(unit)).default_poses()
    poses = options.poses
    if poses is not None:
        poses = pose_names(poses)
    elif asked:
        poses = answered(lambda: ask_poses(usual), pose_names)
    cord = _cord(found, unit, process, options.cord, asked)
    first = FirstDevice(
        _name(options), unit, material, found.edge_length(unit) if edge is None else edge,
        poses or usual, cord, process, cords,
    )  # fmt: skip
    with silent_stdout(), progress_bars(options) as progress:
        create_first_device(found, options.folder, first, progress)
    device = load_device(options.folder)
    size = found.size(unit)
    return {
        "device": str(options.folder), "name": first.name, "body": f"{found.name}{found.suffix}",
        "size_mm": [float(f"{x:.4g}") for x in size], "unit": unit,
        "repaired": found.repairs(unit),
        "edge_length": device.mesh.edge_length,
        "poses": [p.name for p in device.poses], "cord": first.cord, "cords": device.propose,
        "material": first.material, "process": process, "note": describe_unusual_size(size),
    }  # fmt: skip


def _cord(found: DroppedBody, unit: str, process: str, named: str | None, asked: bool) -> str:
    """The cord that is named or chosen. Raises DeviceError for one that there is not, BodyError for
    a body that has no room for it, or for none of those that could be chosen."""
    from ...workflow.starts.first_device import check_room
    from .new_questions import answered, ask_cord, cord_row

    def checked(text: str) -> str:
        cord = cord_row(text)
        check_room(found, unit, cord, process)
        return cord

    if named is not None or not asked:
        return checked(DEFAULT_CORD if named is None else named)
    usual = _usual_cord(found, unit, process)
    return answered(lambda: ask_cord(usual), checked)


def _usual_cord(found: DroppedBody, unit: str, process: str) -> str:
    """The first that the body has room for. Raises BodyError where there is none."""
    from ...workflow.starts.first_device import check_room
    from .new_questions import cords

    for cord in cords():
        with contextlib.suppress(BodyError):
            check_room(found, unit, cord, process)
            return cord
    check_room(found, unit, DEFAULT_CORD, process)
    return DEFAULT_CORD


def _name(options: argparse.Namespace) -> str:
    from ...core.storage.file_names import safe_name

    folder = safe_name(options.folder.resolve().name + ".")
    return folder if options.name is None else str(options.name)


def _tell(begun: dict[str, Any], options: argparse.Namespace) -> None:
    from ...workflow.starts.dropped_body import notable_repairs

    build = f"defsense build {shlex.quote(begun['device'])}"
    with standard_output():
        if options.json:
            print_json({**begun, "next": build})
            return
        folder = Path(begun["device"])
        size = ""
        if "size_mm" in begun:
            x, y, z = begun["size_mm"]
            size = f", {x:g} x {y:g} x {z:g} mm"
        mended = notable_repairs(begun.get("repaired", ()))
        print_lines([
            f"Wrote:   {folder / 'device.toml'} and {begun['body']}{size}",
            *(f"Mended:  {line}" for line in mended),
            *([f"note: {begun['note']}"] if begun["note"] else []),
            f"Poses:   {', '.join(begun['poses'])}",
            f"Cords:   {begun['cords']} of {begun['cord']}; body of {begun['material']} by"
            f" {begun['process']}",
            f"Next:    {build}",
            f"Then:    open {folder / 'build' / 'report.html'}: the cords, and the error to expect",
            f"Change:  poses, regions and cords in {folder / 'device.toml'}, or on the page of"
            f" defsense studio {shlex.quote(begun['device'])}",
        ])  # fmt: skip
