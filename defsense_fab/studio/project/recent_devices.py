"""The devices that the user has opened, in the user's folder for settings."""

from __future__ import annotations

import json
import threading
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

from ...core.device.device_file import DEVICE
from ...core.errors import StorageError
from ...core.storage.files import config_folder, read_regular, storage_errors, write_json

_FILE = "recent-devices.json"
_SCHEMA = 1
MAX_DEVICES = 24


@dataclass(frozen=True)
class Recent:
    """A device that was opened.

    Attributes:
        folder: Its folder, absolute.
        name: Its name when it was opened.
        opened_at: When it was opened, in s since 1970.
    """

    folder: Path
    name: str
    opened_at: float

    @property
    def is_missing(self) -> bool:
        """Whether the folder has no device any more."""
        return not (self.folder / DEVICE).is_file()

    @property
    def current_name(self) -> str:
        """Its name in the file now, or else when it was opened."""
        try:
            document = tomllib.loads(read_regular(self.folder / DEVICE).decode("utf-8"))
        except (OSError, ValueError):
            return self.name
        name = document.get("name")
        return name if isinstance(name, str) and name else self.name


class RecentDevices:
    """The list of devices, which several programs may change.

    A list that cannot be written holds until the program ends.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._session: list[Recent] | None = None  # while the user's folder cannot be written

    def read(self) -> list[Recent]:
        """Return the devices; the one that was opened last comes first."""
        return list(_read_stored() if self._session is None else self._session)

    def add(self, folder: Path, name: str) -> None:
        """Put a device first."""
        folder = folder.absolute()
        with self._lock:
            others = [entry for entry in self.read() if entry.folder != folder]
            self._write([Recent(folder, name, time.time()), *others][:MAX_DEVICES])

    def remove(self, folder: Path) -> None:
        """Remove a device from the list; its folder is kept."""
        with self._lock:
            self._write([entry for entry in self.read() if entry.folder != folder])

    def _write(self, devices: list[Recent]) -> None:
        path = config_folder() / _FILE
        rows = [
            {"folder": str(entry.folder), "name": entry.name, "opened_at": entry.opened_at}
            for entry in devices
        ]
        try:
            with storage_errors(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                write_json(path, {"schema": _SCHEMA, "devices": rows})
        except StorageError:  # the list is a convenience, and no reason not to open a device
            self._session = devices
        else:
            self._session = None


def _read_stored() -> list[Recent]:
    """Return the stored devices; none if the file is missing or cannot be read."""
    try:
        content = json.loads((config_folder() / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    rows = content.get("devices") if isinstance(content, dict) else None
    devices = []
    for row in rows if isinstance(rows, list) else []:
        match row:
            case {"folder": str(folder), "name": str(name), "opened_at": int() | float() as at}:
                devices.append(Recent(Path(folder), name, float(at)))
    return devices[:MAX_DEVICES]
