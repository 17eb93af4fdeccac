"""Command `defsense new`: create a device folder."""

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
    """Add `new`."""
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
        help="Set the poses: modes (body from the body's natural modes), or some of bend, "
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
        raise DeviceError(
            f"{options.name!r} is not a line of printable text",
            code="name-invalid",
            where="--name",
            action="Give one line of letters",
        )
    if folder.exists() and not folder.is_dir():
        raise StorageError(
            "is a file",
            code="not-a-folder",
            where=folder,
            action="Choose another name for the folder",
        )
    if (folder / DEVICE).exists():
        raise StorageError(
            "a device exists here already; it is unchanged",
            code="device-exists",
            where=folder / DEVICE,
            action="Choose another folder",
        )
    interactive = sys.stdin.isatty() and not options.json
    if not interactive and options.body is None:
        names = ", ".join(start.name for start in STARTING_DEVICES)
        raise DeviceError(
            "no body is given",
            code="body-missing",
            where="--body",
            action=f"Give one of {names}, or a body file",
        )
    body = _read_body(options)
    created = (
        _create_from_body(body, options, interactive)
        if body
        else _create_from_example(options, interactive)
    )
    _print_created(created, options)
    return 0


def _read_body(options: argparse.Namespace) -> DroppedBody | None:
    """Return the body of a file, or None if an example of the package is chosen."""
    from ...workflow.starts.dropped_body import load_body_file
    from ...workflow.starts.starting_devices import STARTING_DEVICES
    from .new_questions import ask_body, ask_until_valid

    examples = {start.name for start in STARTING_DEVICES}

    def read(word: str) -> tuple[str, DroppedBody | None]:
        if word in examples:
            return word, None
        if not word.strip("'\" "):
            raise DeviceError(
                "no body is given",
                code="body-missing",
                where="--body",
                action=f"Give one of {', '.join(s.name for s in STARTING_DEVICES)}, or a body file",
            )
        path = _parse_path(word)
        if not path.exists() and not path.suffix:
            raise DeviceError(
                f"is neither a file nor one of {', '.join(s.name for s in STARTING_DEVICES)}",
                code="body-not-found",
                where=word,
                action="Check the path",
                body=word,
            )
        with silent_stdout():
            return word, load_body_file(path)

    if options.body is not None:
        return read(options.body)[1]
    options.body, body = ask_until_valid(ask_body, read)
    return body


def _parse_path(word: str) -> Path:
    """Return a path as typed, or as terminals paste a file that is dropped on them."""
    bare = word.strip("'\"")
    forms = [word, bare]
    if os.name != "nt":
        with contextlib.suppress(ValueError):  # no closing quotation
            forms += shlex.split(word)[:1]
    paths = [Path(form).expanduser() for form in forms]
    return next((p for p in paths if p.exists()), Path(bare).expanduser())


def _create_from_example(options: argparse.Namespace, interactive: bool) -> dict[str, Any]:
    """Create a device from an example, with the example's body and poses."""
    from ...core.device.device_file import load_device
    from ...workflow.starts.first_device import default_material
    from ...workflow.starts.starting_devices import STARTING_DEVICES, create_starting_device
    from .new_questions import ask_cord, ask_until_valid, check_cord

    for name in ("units", "poses", "cords", "process", "material", "edge_length"):
        if getattr(options, name) is not None:
            option = f"--{name.replace('_', '-')}"
            raise DeviceError(
                f"{options.body} has its own value",
                code="options-conflict",
                where=option,
                action="Omit the option, and change device.toml afterwards",
                option=option,
            )
    start = next(s for s in STARTING_DEVICES if s.name == options.body)
    cord = options.cord
    if cord is None and interactive:
        cord = ask_until_valid(lambda: ask_cord(start.cord), check_cord)
    create_starting_device(start, options.folder, _device_name(options), cord and check_cord(cord))
    device = load_device(options.folder)
    material, printed = device.material.name, default_material(device.fabrication.process)
    note = (
        f"the example's body is computed as {material}. Set the printed material, such as"
        f" {printed}, under [material] before the build"
    )
    return {
        "device": str(options.folder), "name": device.name, "body": device.body.path.name,
        "poses": [p.name for p in device.poses], "cord": device.cord.name,
        "cords": len(device.sensors) + device.propose, "material": material,
        "process": device.fabrication.process,
        "note": "" if material == printed else note,
    }  # fmt: skip


def _create_from_body(
    body: DroppedBody, options: argparse.Namespace, interactive: bool
) -> dict[str, Any]:
    """Create a device from a body file."""
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
    from .new_questions import (
        ask_poses,
        ask_unit,
        ask_until_valid,
        check_material,
        check_process,
        parse_poses,
    )

    process = check_process(DEFAULT_PROCESS if options.process is None else options.process)
    named = options.material
    material = default_material(process) if named is None else check_material(named)
    cords, edge = options.cords, options.edge_length
    if cords is not None and not 1 <= cords <= MAX_CORDS:  # 0 is for the studio, which draws them
        raise DeviceError(
            f"{cords} is out of range",
            code="out-of-range",
            where="--cords",
            action=f"Give a number from 1 to {MAX_CORDS}",
            value=cords,
        )

    def checked(text: str) -> str:
        unit = parse_unit(text)
        check_unit(body, unit)
        _first_fitting_cord(body, unit, process)
        return unit

    ask = (lambda: ask_until_valid(lambda: ask_unit(body), checked)) if interactive else None
    unit = choose_unit(body, options.units, ask)
    if edge is not None:
        check_edge_length(body, unit, edge)
    default = find_ends(body.in_mm(unit)).default_poses()
    poses = options.poses
    if poses is not None:
        poses = parse_poses(poses)
    elif interactive:
        poses = ask_until_valid(lambda: ask_poses(default), parse_poses)
    cord = _choose_cord(body, unit, process, options.cord, interactive)
    first = FirstDevice(
        _device_name(options), unit, material, body.edge_length(unit) if edge is None else edge,
        poses or default, cord, process, cords,
    )  # fmt: skip
    with silent_stdout(), progress_bars(options) as progress:
        create_first_device(body, options.folder, first, progress)
    device = load_device(options.folder)
    size = body.size(unit)
    return {
        "device": str(options.folder), "name": first.name, "body": f"{body.name}{body.suffix}",
        "size_mm": [float(f"{x:.4g}") for x in size], "unit": unit,
        "repaired": body.repairs(unit),
        "edge_length": device.mesh.edge_length,
        "poses": [p.name for p in device.poses], "cord": first.cord, "cords": device.propose,
        "material": first.material, "process": process, "note": describe_unusual_size(size),
    }  # fmt: skip


def _choose_cord(
    body: DroppedBody, unit: str, process: str, named: str | None, interactive: bool
) -> str:
    """Return the given or chosen cord, after checking that it exists and fits the body."""
    from ...workflow.starts.first_device import check_room
    from .new_questions import ask_cord, ask_until_valid, check_cord

    def checked(text: str) -> str:
        cord = check_cord(text)
        check_room(body, unit, cord, process)
        return cord

    if named is not None or not interactive:
        return checked(DEFAULT_CORD if named is None else named)
    default = _first_fitting_cord(body, unit, process)
    return ask_until_valid(lambda: ask_cord(default), checked)


def _first_fitting_cord(body: DroppedBody, unit: str, process: str) -> str:
    """Return the first cord that fits the body, or raise BodyError."""
    from ...workflow.starts.first_device import check_room
    from .new_questions import cord_names

    for cord in cord_names():
        with contextlib.suppress(BodyError):
            check_room(body, unit, cord, process)
            return cord
    check_room(body, unit, DEFAULT_CORD, process)
    return DEFAULT_CORD


def _device_name(options: argparse.Namespace) -> str:
    from ...core.storage.file_names import safe_name

    folder = safe_name(options.folder.resolve().name + ".")
    return folder if options.name is None else str(options.name)


def _print_created(created: dict[str, Any], options: argparse.Namespace) -> None:
    from ...workflow.starts.dropped_body import notable_repairs

    build = f"defsense build {shlex.quote(created['device'])}"
    with standard_output():
        if options.json:
            print_json({**created, "next": build})
            return
        folder = Path(created["device"])
        size = ""
        if "size_mm" in created:
            x, y, z = created["size_mm"]
            size = f", {x:g} x {y:g} x {z:g} mm"
        repairs = notable_repairs(created.get("repaired", ()))
        print_lines([
            f"Wrote:   {folder / 'device.toml'} and {created['body']}{size}",
            *(f"Fixed:   {line}" for line in repairs),
            *([f"note: {created['note']}"] if created["note"] else []),
            f"Poses:   {', '.join(created['poses'])}",
            f"Cords:   {created['cords']} of {created['cord']}; body of {created['material']} by"
            f" {created['process']}",
            f"Next:    {build}",
            f"Then:    open {folder / 'build' / 'report.html'}: the cords and the expected error",
            f"Change:  poses, regions and cords in {folder / 'device.toml'}, or on the page of"
            f" defsense studio {shlex.quote(created['device'])}",
        ])  # fmt: skip
