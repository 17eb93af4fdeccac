"""Devices that come with the package, to begin with."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import tomlkit

from ...core.device_file import DEVICE
from ...core.errors import StorageError
from ...core.files import replacing, storage_errors, write_text

_one = threading.Lock()  # two people may begin at once
_FOLDER = files("defsense_fab") / "data" / "devices"


@dataclass(frozen=True)
class StartingDevice:
    """Its folder among the package's data, what it is called on a button, and what it is."""

    name: str
    title: str
    about: str

    @property
    def script(self) -> bytes | None:
        """The program that makes its body; None where it is a mesh."""
        told = tomlkit.parse((_FOLDER / self.name / DEVICE).read_text(encoding="utf-8"))
        name = told.unwrap()["body"].get("script")
        return None if name is None else (_FOLDER / self.name / name).read_bytes()

    @property
    def picture(self) -> bytes:
        """A PNG file."""
        return (_FOLDER / f"{self.name}.png").read_bytes()


STARTS = (
    StartingDevice(
        "bar", "Bar", "Three cords tell bends up and down, and twists. A script makes the body."
    ),
    StartingDevice("twist-bar", "Twist bar", "One cord tells left from right twists."),
    StartingDevice(
        "cube", "Cube", "Pressed, sheared and twisted; planes of three cords cross inside."
    ),
    StartingDevice("blob", "Blob", "An organic body from a mesh, whose cords are proposed."),
)


def begin_with(start: StartingDevice, folder: Path, name: str) -> None:
    """Put the device into a folder, which may not be there yet, under a `name` of its own. Raises
    StorageError where the folder has a device or one of its files, and where it cannot be
    written."""
    source = _FOLDER / start.name
    document = tomlkit.parse((source / DEVICE).read_text(encoding="utf-8"))
    document["name"] = name
    body: Any = document["body"]
    file = str(body.get("script") or body.get("mesh"))
    put_device(folder, file, (source / file).read_bytes(), tomlkit.dumps(document))


def put_device(folder: Path, file: str, content: bytes, text: str) -> None:
    """Write the body's `file`, then the device's; each whole or not at all. Raises StorageError."""
    with _one:
        with storage_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        for name in (DEVICE, file):
            if (folder / name).exists():
                raise StorageError(f"{folder / name}: is there already; choose another folder")
        with replacing(folder / file) as temporary:
            temporary.write_bytes(content)
        write_text(folder / DEVICE, text)
