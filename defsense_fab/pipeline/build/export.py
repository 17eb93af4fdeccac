"""All that a maker takes along, in one file: the parts, how they are put together, the design."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from pathlib import Path

from ...core.device.device import Device
from ...core.device.device_file import DEVICE
from ...core.errors import StorageError
from ...core.storage.file_names import is_reserved
from ...core.storage.files import replacing
from ..artifacts import mesh_lock
from ..artifacts.layout import LAYOUT
from ..artifacts.manifest import FOLDER, Manifest, load_manifest
from ..report.guide.tables import guide_tables
from . import body_sources
from .asked import changes
from .build import undisturbed
from .freshness import outdated

_WRITTEN = ("guide.html", "guide.json", "guide.pdf", "report.html", LAYOUT)
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of all files, so that the same build gives the same bytes


def export_name(device: Device) -> str:
    """Of the zip: the device's name, as file systems take it."""
    name = re.sub(r"[^\w.-]+", "-", device.name)[:80].strip("-.") or "device"
    return f"device-{name}.zip" if is_reserved(name) else f"{name}.zip"


def export(device: Device, path: Path) -> tuple[str, ...]:
    """Write parts, guide, report, `layout.json`, cut list and bill as CSV, `device.toml` and the
    files that the body is made from to a zip, whole or not at all; the names in it. Of files
    outside of the device's folder it takes scripts and CAD files alone.

    The same build gives the same bytes. Raises StorageError where the build is not that of the
    device as it is now, while another one runs, and where nothing can be written.
    """
    with undisturbed(device) as folder:
        stage = outdated(device)
        if stage is not None:
            why = changes(device, folder)
            raise StorageError(
                f"{folder}: has no parts of the device as it is now: '{stage.title}' has still to"
                f" be done{f', for {why}' if why else ''}; build everything first"
            )
        files = _files(device, folder)
        written = _tables(load_manifest(folder))
        names = tuple(sorted([*files, *written]))
        with replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as out:
            for name in names:
                info = zipfile.ZipInfo(name, _EPOCH)
                info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                data = files[name].read_bytes() if name in files else written[name].encode()
                out.writestr(info, data)
    return names


def _files(device: Device, folder: Path) -> dict[str, Path]:
    """By the name in the zip. Sources that lie outside of the device's folder come as they are
    called, in `outside/`."""
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
            raise StorageError(f"{path}: leads out of the device's folder; build it again")
    sources = [device.body.path, *map(Path, body_sources.recorded(folder) or {})]
    for path in (device.source / s for s in sources):
        whole = path.resolve()
        near = whole.is_relative_to(inside)
        # A folder that came from elsewhere may name any file of this machine.
        if whole.is_file() and (near or whole.suffix.lower() in body_sources.SUFFIXES):
            out[whole.relative_to(inside).as_posix() if near else f"outside/{whole.name}"] = whole
    return out


def _tables(manifest: Manifest) -> dict[str, str]:
    """The guide's tables as files: print.csv, cut-list.csv, bill-of-materials.csv."""
    out = {}
    for table in guide_tables(manifest):
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([table.header, *table.rows])
        out[table.title.lower().replace(" ", "-") + ".csv"] = text.getvalue()
    return out
