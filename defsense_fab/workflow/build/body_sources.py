"""Which files a body was made from, kept with it: the body is up to date while they are as then."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path

from ...core.device.device import Device
from ...core.storage.files import write_json
from ...core.device.build_folder import own_files
from ...geometry.bodies.script_process import SourceFile

_FILE = "body/sources.json"
#: CAD kernels open these unseen: all that lie with a script are taken for read.
_CAD = {
    ".step", ".stp", ".brep", ".stl", ".obj", ".ply", ".off", ".3mf", ".glb", ".gltf", ".msh",
    ".vtu", ".mesh", ".dxf", ".svg",
}  # fmt: skip
#: Of files that a body is made from.
SUFFIXES = {".py", *_CAD}
#: Folders of builds: the last one, one that goes on, what was kept of others, the one before.
BUILDS = ("build", ".build-next", ".build-kept", ".build-old")


def cad_files(device: Device) -> list[SourceFile]:
    """CAD files in the device's folder, where a script makes the body; not those of results."""
    if device.body.kind != "script":
        return []
    return [SourceFile.now(p) for p in own_files(device.source) if p.suffix.lower() in _CAD]


def record(device: Device, folder: Path, sources: Iterable[SourceFile]) -> None:
    """Write what the body in the build's `folder` was made from; files of builds do not count."""
    files = {name_of(device, s.path): s.content for s in sources}
    kept = {n: c for n, c in sorted(files.items()) if n.split("/")[0] not in BUILDS}
    write_json(folder / _FILE, kept)


def recorded(folder: Path) -> dict[str, str | None] | None:
    """Files, and the hashes of their contents when the body was made; None where it was not."""
    try:
        found = json.loads((folder / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def unchanged(device: Device, folder: Path) -> bool:
    """Whether the files that the body in `folder` was made from are as they were, and those that
    its script looked for in vain are still missing."""
    files = recorded(folder)
    return files is not None and all(
        SourceFile.now(device.source / name).content == content for name, content in files.items()
    )


def name_of(device: Device, path: Path) -> str:
    """Relative in the device's folder, which may be moved; absolute elsewhere."""
    whole, folder = Path(os.path.abspath(path)), Path(os.path.abspath(device.source))
    return (whole.relative_to(folder) if whole.is_relative_to(folder) else whole).as_posix()
