"""Command `defsense new`: create a device folder."""

from __future__ import annotations

import contextlib
import os
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from ...core.errors import DeviceError, StorageError
from ...workflow.starts.options import EXAMPLES, NewOptions, check_row
from ..app import command
from ..output import (
    OutputOptions,
    print_json,
    print_lines,
    progress_bars,
    silent_stdout,
    standard_output,
)

if TYPE_CHECKING:
    from ...workflow.starts.body_file import BodyFile

_NO_OPTIONS = NewOptions()
_NO_OUTPUT = OutputOptions()

new = command(
    "new",
    "defsense new my-device",
    "defsense new wand --body wand.step --poses bend,twist",
    "defsense new bunny --body bunny.stl --units mm --poses modes --cord rubber-1.7mm",
    "defsense new hand --body hand.obj --size 170",
)


@new.default
def _new(
    folder: Path,
    /,
    *,
    options: Annotated[NewOptions, Parameter(name="*")] = _NO_OPTIONS,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Create a device folder from an example of the package or from a body file.

    In a terminal, missing values are requested; press Enter to accept the default in brackets.
    With --json, no questions are asked.

    Args:
        folder: Set the folder to create.
    """
    from ...core.storage.file_names import safe_name

    _check_folder(folder)
    interactive = sys.stdin.isatty() and not output.json
    name = options.name or safe_name(folder.resolve().name + ".")
    word, body = _choose_body(options.body, interactive)
    options = replace(options, body=word, name=name)
    if body is None:
        created = _create_from_example(folder, options, interactive)
    else:
        created = _create_from_body(folder, body, options, interactive, output)
    with standard_output():
        if output.json:
            build = f"defsense build {shlex.quote(created['device'])}"
            print_json({**created, "next": build})
        else:
            print_lines(_describe_created(created))


def _check_folder(folder: Path) -> None:
    """Check that a device can be created in a folder."""
    from ...core.device.device_file import DEVICE
    from ...core.storage.file_names import check_folder_name

    check_folder_name(folder)
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


def _choose_body(word: str | None, interactive: bool) -> tuple[str, BodyFile | None]:
    """Return the given or chosen word for a body, and its file; None for an example."""
    from .new_questions import ask_body, ask_until_valid

    if word is None and interactive:
        return ask_until_valid(ask_body, _read_body)
    return _read_body(word or "")


def _read_body(word: str) -> tuple[str, BodyFile | None]:
    """Return the word for a body, and its file; None for an example of the package."""
    from ...workflow.starts.body_file import load_body_file

    if word in EXAMPLES:
        return word, None
    names = ", ".join(EXAMPLES)
    if not word.strip("'\" "):
        raise DeviceError(
            "no body is given",
            code="body-missing",
            where="--body",
            action=f"Give one of {names}, or a body file",
        )
    path = _parse_path(word)
    if not path.exists() and not path.suffix:
        raise DeviceError(
            f"is neither a file nor one of {names}",
            code="body-not-found",
            where=word,
            action="Check the path",
            body=word,
        )
    with silent_stdout():
        return word, load_body_file(path)


def _parse_path(word: str) -> Path:
    """Return a path as typed, or as terminals paste a file that is dropped on them."""
    bare = word.strip("'\"")
    forms = [word, bare]
    if os.name != "nt":
        with contextlib.suppress(ValueError):  # no closing quotation
            forms += shlex.split(word)[:1]
    paths = [Path(form).expanduser() for form in forms]
    return next((p for p in paths if p.exists()), Path(bare).expanduser())


def _create_from_example(folder: Path, options: NewOptions, interactive: bool) -> dict[str, Any]:
    """Create a device from an example, with the example's body and poses."""
    from ...core.device.device_file import load_device
    from ...workflow.starts.starting_devices import STARTING_DEVICES, create_starting_device
    from .new_questions import ask_cord, ask_until_valid

    options.check_example()
    start = next(s for s in STARTING_DEVICES if s.name == options.body)
    cord = options.cord
    if cord is None and interactive:
        cord = ask_until_valid(lambda: ask_cord(start.cord), lambda text: check_row("cord", text))
    create_starting_device(start, folder, str(options.name), cord)
    device = load_device(folder)
    return {
        "device": str(folder),
        "name": device.name,
        "body": device.body.path.name,
        "poses": [p.name for p in device.poses],
        "cord": device.cord.name,
        "cords": len(device.sensors) + device.propose,
        "material": device.material.name,
        "process": device.fabrication.process,
        "note": "",
        "reach": "",
    }


def _create_from_body(
    folder: Path, body: BodyFile, options: NewOptions, interactive: bool, output: OutputOptions
) -> dict[str, Any]:
    """Create a device from a body file."""
    from ...workflow.starts.body_ends import find_ends
    from ...workflow.starts.body_file import choose_unit, describe_unusual_size, scale_to_size
    from ...workflow.starts.first_device import create_first_device
    from ...workflow.starts.reachable_poses import describe_reach
    from .new_questions import ask_choices

    body = scale_to_size(body, options.size)
    if interactive:
        body, options = ask_choices(body, options)
    with silent_stdout(), progress_bars(output) as progress:
        device = create_first_device(body, folder, options, progress)
    unit = choose_unit(body, options.units)
    size = body.size(unit)
    return {
        "device": str(folder),
        "name": device.name,
        "body": f"{body.name}{body.suffix}",
        "size_mm": [float(f"{x:.4g}") for x in size],
        "unit": unit if body.factor == 1 else None,
        "scale": body.scale(unit),
        "repaired": body.repairs(unit),
        "edge_length": device.mesh.edge_length,
        "poses": [p.name for p in device.poses],
        "cord": device.cord.name,
        "cords": device.propose,
        "material": device.material.name,
        "process": device.fabrication.process,
        "note": describe_unusual_size(size),
        "reach": describe_reach(find_ends(body.in_mm(unit)), device),
    }


def _describe_created(created: dict[str, Any]) -> list[str]:
    """Return lines on a created device, and the next commands."""
    from ...workflow.starts.body_file import notable_repairs

    folder, quoted = Path(created["device"]), shlex.quote(created["device"])
    size = ""
    if "size_mm" in created:
        x, y, z = created["size_mm"]
        size = f", {x:g} x {y:g} x {z:g} mm"
    return [
        f"Wrote:   {folder / 'device.toml'} and {created['body']}{size}",
        *(f"Fixed:   {line}" for line in notable_repairs(created.get("repaired", ()))),
        *(f"note: {created[key]}" for key in ("note", "reach") if created[key]),
        f"Poses:   {', '.join(created['poses'])}",
        f"Cords:   {created['cords']} of {created['cord']}; body of {created['material']} by"
        f" {created['process']}",
        f"Next:    defsense build {quoted}",
        f"Then:    open {folder / 'build' / 'report.html'}: the cords and the expected error",
        f"Change:  poses, regions and cords in {folder / 'device.toml'}, or on the page of"
        f" defsense studio {quoted}",
    ]
