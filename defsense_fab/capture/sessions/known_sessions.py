"""The training sessions in a device's folder, and whether they can be trained on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...core.storage.session_manifest import FILE, load_capture
from ...store.layout import LAYOUT, layout_hash, load_layout
from .result_files import ALIGNED, QUALITY


@dataclass(frozen=True)
class KnownSession:
    """A session's folder; when it was begun (ISO 8601) and of which `unit`; how many pictures and
    seconds were processed; why it cannot be trained on (`problem`), None where it can; whether it
    was recorded, and is yet to be processed (`raw`)."""

    folder: Path
    begun: str
    unit: str
    frames: int
    seconds: float
    problem: str | None = None
    raw: bool = False

    @property
    def about(self) -> str:
        """In a line."""
        unit = f"unit {self.unit}, " if self.unit else ""
        return f"{unit}{self.seconds:.0f} s, {self.frames} pictures"


def known_sessions(device: Device) -> list[KnownSession]:
    """Of the device's folder, and of folders in it that hold several; the newest last."""
    built, layout = build_folder(device), ""
    try:
        layout = layout_hash(load_layout(built)) if (built / LAYOUT).exists() else ""
    except DefsenseError:  # a damaged build is told where it is used
        layout = ""
    files = [p for depth in ("*", "*/session-*") for p in device.source.glob(f"{depth}/{FILE}")]
    found = [_known(p.parent, device, layout) for p in files if _of_a_device(p)]
    return sorted(found, key=lambda s: (s.begun, s.folder))


def _of_a_device(path: Path) -> bool:
    """Not on a specimen, whose sessions have the same file."""
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return True  # told by its reader
    return not (isinstance(said, dict) and "specimen" in said)


def _known(folder: Path, device: Device, layout: str) -> KnownSession:
    try:
        said = load_capture(folder)
    except DefsenseError as error:
        return KnownSession(folder, "", "", 0, 0.0, str(error))
    problem, frames, seconds, raw = None, 0, 0.0, False
    try:
        quality = json.loads((folder / QUALITY).read_text(encoding="utf-8"))
        frames, seconds = int(quality["frames"]), float(quality["seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        problem = f"is not processed; run 'defsense capture process {folder}'"
        raw = any(folder.glob("run-*/*.csv"))
    if problem is None and not (folder / ALIGNED).exists():
        problem = f"has no {ALIGNED}; run 'defsense capture process {folder}'"
    if said.device != device.name:
        problem = f"is of another device, {said.device}"
    elif layout and said.layout and said.layout != layout:
        problem = "was recorded with other cords than are built now; build those, or record anew"
    return KnownSession(folder, said.begun, said.unit, frames, seconds, problem, raw)
