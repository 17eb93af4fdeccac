"""All that a maker takes along, in one file: the parts, how they are put together, the design."""

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
from ...geometry.bodies.meshing import mesh_lock
from ...report.guide.tables import guide_tables
from ...store.layout import LAYOUT
from ...store.manifest import FOLDER, Manifest, load_manifest
from . import body_sources
from .build import build_lock, first_outdated
from .options import changed_options

_WRITTEN = ("guide.html", "guide.json", "guide.pdf", "report.html", LAYOUT)
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of all files, so that the same build gives the same bytes


def describe_changes(device: Device, folder: Path) -> str:
    """Return which options of the plates changed since a build, as a clause; empty if none did."""
    return ", ".join(
        f"[fabrication] {key} is {_describe(new)} and was {_describe(old)} in that build"
        for key, (old, new) in changed_options(device, folder).items()
    )


def _describe(value: object) -> str:
    return " x ".join(f"{n:g}" for n in value) if isinstance(value, list) else str(value)


def export_name(device: Device) -> str:
    """Of the zip: the device's name, as file systems take it."""
    name = re.sub(r"[^\w.-]+", "-", device.name)[:80].strip("-.") or "device"
    return f"device-{name}.zip" if is_reserved(name) else f"{name}.zip"


def export(device: Device, path: Path) -> tuple[str, ...]:
    """Write parts, guide, report, `layout.json`, cut list and bill as CSV, `device.toml` and the
    files that the body is made from to a zip, whole or not at all; the names in it. Of files
    outside of the device's folder it takes scripts and CAD files alone.

    The same build gives the same bytes. Raises StorageError where the build is not that of the
    device as it is now, while another one runs, where two files would have one name, and where
    nothing can be written.
    """
    with build_lock(device) as folder:
        stage = first_outdated(device)
        if stage is not None:
            changes = describe_changes(device, folder)
            raise StorageError(
                "the parts are not those of the device as it is now"
                f"{f', as {changes}' if changes else ''}",
                code="build-outdated",
                where=folder,
                action="Build everything first",
                stage=stage.name,
            )
        written = _tables(load_manifest(folder))
        files = _files(device, folder, written)
        names = tuple(sorted([*files, *written]))
        with replace_file(path) as temporary, zipfile.ZipFile(temporary, "w") as out:
            for name in names:
                info = zipfile.ZipInfo(name, _EPOCH)
                info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                data = files[name].read_bytes() if name in files else written[name].encode()
                out.writestr(info, data)
    return names


def _files(device: Device, folder: Path, others: Iterable[str] = ()) -> dict[str, Path]:
    """By the name in the zip, where `others` lie besides. Sources that lie outside of the device's
    folder come as they are called, in `outside/`, those of one name by number. Raises StorageError
    for one inside of it whose name another file has on some system."""
    parts = folder / FOLDER
    out = {
        f"{FOLDER}/{p.relative_to(parts).as_posix()}": p for p in parts.rglob("*") if p.is_file()
    }
    out |= {name: folder / name for name in _WRITTEN}
    out |= {
        p.name: p for p in (device.source / DEVICE, device.source / mesh_lock.FILE) if p.exists()
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
    for path in _sources(device, folder, inside):
        if path.is_relative_to(inside):
            name = path.relative_to(inside).as_posix()
        else:
            name = _free(f"outside/{path.name}", taken)
        if taken.setdefault(fold_name(name), path) != path:
            raise StorageError(
                "another file of the zip has the same name, apart from upper and lower case",
                code="names-collide",
                where=path,
                action="Rename it, or move it to another folder of the device",
                name=name,
            )
        out[name] = path
    return out


def _sources(device: Device, folder: Path, inside: Path) -> list[Path]:
    """What the body was made from, whole paths, those in the device's folder first."""
    given = [device.body.path, *map(Path, body_sources.load_sources(folder) or {})]
    found = dict.fromkeys((device.source / s).resolve() for s in given)
    files = [p for p in found if p.is_file()]
    near = [p for p in files if p.is_relative_to(inside)]
    # A folder that came from elsewhere may name any file of this machine.
    far = [p for p in files if p.suffix.lower() in body_sources.SUFFIXES and p not in near]
    return near + far


def _free(name: str, taken: Container[str]) -> str:
    """The name, or the first of a.py, a-2.py, a-3.py, ... that is not taken."""
    path, number, free = PurePosixPath(name), 1, name
    while fold_name(free) in taken:
        number += 1
        free = str(path.with_stem(f"{path.stem}-{number}"))
    return free


def _tables(manifest: Manifest) -> dict[str, str]:
    """The guide's tables as files: print.csv, cut-list.csv, bill-of-materials.csv."""
    out = {}
    for table in guide_tables(manifest):
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([table.header, *table.rows])
        out[table.title.lower().replace(" ", "-") + ".csv"] = text.getvalue()
    return out
