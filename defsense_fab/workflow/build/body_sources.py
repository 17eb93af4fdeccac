"""The files a body was made from; the body is up to date while their contents are unchanged."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path

from ...core.device.build_folder import own_files
from ...core.device.device import Device
from ...core.storage.files import write_json
from ...geometry.bodies.script_process import SourceFile

_FILE = "body/sources.json"
# CAD kernels open files without Python noticing: every CAD file next to a script counts as read.
_CAD_SUFFIXES = {
    ".step", ".stp", ".brep", ".stl", ".obj", ".ply", ".off", ".3mf", ".glb", ".gltf", ".msh",
    ".vtu", ".mesh", ".dxf", ".svg",
}  # fmt: skip
#: Suffixes of files that a body can be made from.
SUFFIXES = {".py", *_CAD_SUFFIXES}
#: Folders of builds: the last good one, the running one, completed stages of failed ones, and the
#: one being replaced.
BUILDS = ("build", ".build-next", ".build-kept", ".build-old")

Sources = dict[str, str | None]


def cad_files(device: Device) -> list[SourceFile]:
    """Return the CAD files in the device's folder, without results; none if no script is used."""
    if device.body.kind != "script":
        return []
    return [
        SourceFile.from_path(p)
        for p in own_files(device.source)
        if p.suffix.lower() in _CAD_SUFFIXES
    ]


def save_sources(device: Device, folder: Path, sources: Iterable[SourceFile]) -> None:
    """Record the files that the body in a build's folder was made from, without those of builds."""
    files = {relative_name(device, s.path): s.content for s in sources}
    own = {n: c for n, c in sorted(files.items()) if n.split("/")[0] not in BUILDS}
    write_json(folder / _FILE, own)


def load_sources(folder: Path) -> Sources | None:
    """Return the recorded content hash of each source file; None without a record."""
    try:
        sources = json.loads((folder / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return sources if isinstance(sources, dict) else None


def is_unchanged(device: Device, folder: Path) -> bool:
    """Whether all source files of the body are as recorded.

    Files that the script looked for in vain must still be missing.
    """
    sources = load_sources(folder)
    return sources is not None and all(
        SourceFile.from_path(device.source / name).content == content
        for name, content in sources.items()
    )


def relative_name(device: Device, path: Path) -> str:
    """Return a path relative to the device's folder, which may be moved; absolute elsewhere."""
    whole, folder = Path(os.path.abspath(path)), Path(os.path.abspath(device.source))
    return (whole.relative_to(folder) if whole.is_relative_to(folder) else whole).as_posix()
