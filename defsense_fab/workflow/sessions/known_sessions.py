"""The training sessions in a device's folder, and whether they can be used for training."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ...capture.sessions.results import ALIGNED, QUALITY
from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...core.storage.files import read_regular
from ...core.storage.session_manifest import FILE, load_capture
from ...store.layout import LAYOUT, layout_hash, load_layout


@dataclass(frozen=True)
class KnownSession:
    """A session of a device.

    Attributes:
        folder: Folder of the session.
        started_at: When it was created (ISO 8601).
        unit: Name of the unit.
        frames: Number of processed images.
        seconds: Processed time, s.
        code: Why it cannot be used for training: the code of the error that loading it raises, such
            as "session-not-processed" or "layouts-differ"; empty if it can.
        problem: The same as a text; empty if it can be used.
        is_raw: Whether it was recorded, but not processed yet.
    """

    folder: Path
    started_at: str = ""
    unit: str = ""
    frames: int = 0
    seconds: float = 0.0
    code: str = ""
    problem: str = ""
    is_raw: bool = False

    @property
    def is_usable(self) -> bool:
        """Whether it can be used for training."""
        return not self.code

    @property
    def summary(self) -> str:
        """Description in one line."""
        unit = f"unit {self.unit}, " if self.unit else ""
        return f"{unit}{self.seconds:.0f} s, {self.frames} images"


def known_sessions(device: Device) -> list[KnownSession]:
    """Return the sessions of a device's folder, also those in folders of several; newest last."""
    build, layout = build_folder(device), ""
    try:
        layout = layout_hash(load_layout(build)) if (build / LAYOUT).exists() else ""
    except DefsenseError:  # a damaged build is reported where it is used
        layout = ""
    files = [p for depth in ("*", "*/session-*") for p in device.source.glob(f"{depth}/{FILE}")]
    sessions = [_read_session(p.parent, device, layout) for p in files if _is_of_device(p)]
    return sorted(sessions, key=lambda s: (s.started_at, s.folder))


def _is_of_device(path: Path) -> bool:
    """Return whether a session file is of a device; sessions of specimens have the same file."""
    try:
        data = json.loads(read_regular(path))
    except (OSError, ValueError):
        return True  # its reader reports it
    return not (isinstance(data, dict) and "specimen" in data)


def _read_session(folder: Path, device: Device, layout: str) -> KnownSession:
    try:
        manifest = load_capture(folder)
    except DefsenseError as error:
        return KnownSession(folder, code=error.code, problem=str(error))
    code, problem, frames, seconds, is_raw = "", "", 0, 0.0, False
    try:
        quality = json.loads(read_regular(folder / QUALITY))
        frames, seconds = int(quality["frames"]), float(quality["seconds"])
    except (OSError, ValueError, KeyError, TypeError):
        is_raw = any(folder.glob("run-*/*.csv"))
        code, problem = "session-not-processed", "is not processed"
    if not code and not (folder / ALIGNED).exists():
        code, problem = "session-not-processed", f"has no {ALIGNED}"
    if code:
        problem += f". Run 'defsense capture process {folder}'"
    if manifest.device != device.name:
        code, problem = "devices-differ", f"is of another device, {manifest.device}"
    elif layout and manifest.layout and manifest.layout != layout:
        code = "layouts-differ"
        problem = "was recorded with other cords than are built now. Build those, or record again"
    return KnownSession(
        folder, manifest.begun, manifest.unit, frames, seconds, code, problem, is_raw
    )
