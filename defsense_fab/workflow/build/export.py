"""Export a built device as one zip: parts, guide, report, tables and the files of its design."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Container, Iterable
from pathlib import Path, PurePosixPath

from ...core.device.device import Device
from ...core.device.device_file import DEVICE
from ...core.errors import StorageError
from ...core.storage.file_names import fold_name, is_reserved
from ...core.storage.files import replace_file
from ...geometry.bodies.meshing import mesh_store
from ...report.guide.tables import guide_tables
from ...store.layout import LAYOUT
from ...store.manifest import FOLDER, Manifest, load_manifest
from ..board.wiring import DRAWING, HARNESS
from . import body_sources
from .build import build_lock, first_outdated
from .recorded_options import changed_options

_BUILD_FILES = ("guide.html", "guide.json", "templates.pdf", "report.html", LAYOUT)
_FILE_TIME = (1980, 1, 1, 0, 0, 0)  # so that the same build gives the same bytes


def describe_changes(device: Device, folder: Path) -> str:
    """Return which options of the plates changed since a build, as a clause; empty if none did."""
    return ", ".join(
        f"{key} is {_describe(new)} and was {_describe(old)} in that build"
        for key, (old, new) in changed_options(device, folder).items()
    )


def _describe(value: object) -> str:
    return " x ".join(f"{n:g}" for n in value) if isinstance(value, list) else str(value)


def export_name(device: Device) -> str:
    """Return the file name of a device's zip, with characters that every file system accepts."""
    name = re.sub(r"[^\w.-]+", "-", device.name)[:80].strip("-.") or "device"
    return f"device-{name}.zip" if is_reserved(name) else f"{name}.zip"


def export(device: Device, path: Path) -> tuple[str, ...]:
    """Export a built device to a zip, completely or not at all.

    The zip holds parts, guide, report, wiring, `layout.json`, cut list and bill of materials as
    CSV, `device.toml` and the files from which the body is made. Of files outside the device's
    folder, it holds only scripts and CAD files. The same build gives the same bytes.

    Args:
        device: The device.
        path: The zip to write.

    Returns:
        Names of the files in the zip.

    Raises:
        StorageError: The build is not that of the current device, another build is running, two
            files would have the same name, or the zip cannot be written.
    """
    with build_lock(device) as folder:
        stage = first_outdated(device)
        if stage is not None:
            changes = describe_changes(device, folder)
            raise StorageError(
                "the parts do not belong to the current device"
                f"{f', as {changes}' if changes else ''}",
                code="build-outdated",
                where=folder,
                action="Build everything first",
                stage=stage.name,
            )
        written = _csv_tables(load_manifest(folder))
        files = _files(device, folder, written)
        names = tuple(sorted([*files, *written]))
        with replace_file(path) as temporary, zipfile.ZipFile(temporary, "w") as out:
            for name in names:
                info = zipfile.ZipInfo(name, _FILE_TIME)
                info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                data = files[name].read_bytes() if name in files else written[name].encode()
                out.writestr(info, data)
    return names


def _files(device: Device, folder: Path, others: Iterable[str] = ()) -> dict[str, Path]:
    """Return the files of the zip by name; `others` are further names in the zip.

    Sources outside the device's folder are placed in `outside/`, numbered if their names collide.
    Raises StorageError if a source inside it has the name of another file, ignoring case.
    """
    parts = folder / FOLDER
    out = {
        f"{FOLDER}/{p.relative_to(parts).as_posix()}": p for p in parts.rglob("*") if p.is_file()
    }
    out |= {name: folder / name for name in _BUILD_FILES}
    out |= {name: folder / name for name in (DRAWING, HARNESS) if (folder / name).exists()}
    out |= {
        p.name: p
        for p in (device.source / DEVICE, device.source / mesh_store.DEVICE_MESH)
        if p.exists()
    }
    inside = device.source.resolve()
    for path in out.values():
        if not path.resolve().is_relative_to(inside):
            raise StorageError(
                "leads out of the device's folder",
                code="outside-device-folder",
                where=path,
                action="Build the device again",
            )
    taken: dict[str, Path | None] = {fold_name(n): p.resolve() for n, p in out.items()}
    taken |= dict.fromkeys(map(fold_name, others))
    for path in _source_files(device, folder, inside):
        if path.is_relative_to(inside):
            name = path.relative_to(inside).as_posix()
        else:
            name = _unused_name(f"outside/{path.name}", taken)
        if taken.setdefault(fold_name(name), path) != path:
            raise StorageError(
                "another file of the zip has the same name, apart from upper and lower case",
                code="name-repeated",
                where=path,
                action="Rename it, or move it to another folder of the device",
                name=name,
            )
        out[name] = path
    return out


def _source_files(device: Device, folder: Path, inside: Path) -> list[Path]:
    """Return the files from which the body was made, those in the device's folder first."""
    sources = [device.body.path, *map(Path, body_sources.load_sources(folder) or {})]
    paths = dict.fromkeys((device.source / s).resolve() for s in sources)
    files = [p for p in paths if p.is_file()]
    inside_files = [p for p in files if p.is_relative_to(inside)]
    # A folder from someone else may name any file of this machine.
    outside_files = [
        p for p in files if p.suffix.lower() in body_sources.SUFFIXES and p not in inside_files
    ]
    return inside_files + outside_files


def _unused_name(name: str, taken: Container[str]) -> str:
    """Return the name, or the first of a-2.py, a-3.py, ... that is not taken."""
    path, number, candidate = PurePosixPath(name), 1, name
    while fold_name(candidate) in taken:
        number += 1
        candidate = str(path.with_stem(f"{path.stem}-{number}"))
    return candidate


def _csv_tables(manifest: Manifest) -> dict[str, str]:
    """Return the guide's tables as CSV files: print, cut-list and bill-of-materials."""
    out = {}
    for table in guide_tables(manifest):
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([table.header, *table.rows])
        out[table.title.lower().replace(" ", "-") + ".csv"] = text.getvalue()
    return out
