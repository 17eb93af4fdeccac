"""Devices that come with the package, to begin with."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from ...core.device.device_file import DEVICE, DeviceFile, parse_device
from ...core.errors import StorageError
from ...core.schema.reference import commented
from ...core.storage.files import replace_file, storage_errors, write_text
from ...core.storage.package_data import package_data

_one = threading.Lock()  # two people may begin at once
_FOLDER = package_data("devices")


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
    def cord(self) -> str:
        """Its row of cords.csv."""
        told = tomlkit.parse((_FOLDER / self.name / DEVICE).read_text(encoding="utf-8"))
        return str(told.unwrap()["cord"]["name"])

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


def begin_with(start: StartingDevice, folder: Path, name: str, cord: str | None = None) -> None:
    """Put the device into a folder, which may not be there yet, under a `name` of its own, and with
    another `cord` where one is given. Raises StorageError where the folder has a device or one of
    its files, and where it cannot be written."""
    source = _FOLDER / start.name
    document: Any = tomlkit.parse((source / DEVICE).read_text(encoding="utf-8"))
    document["name"] = name
    if cord is not None and cord != start.cord:
        document["cord"]["name"] = cord
        document["cord"].pop("noise", None)  # that of the cord before
    body = document["body"]
    file = str(body.get("script") or body.get("mesh"))
    content = (source / file).read_bytes()
    text = commented(tomlkit.dumps(document), DeviceFile)
    with tempfile.TemporaryDirectory(prefix="defsense-") as other:
        (Path(other) / file).touch()
        parse_device(text, Path(other))
    put_device(folder, {file: content}, text)


def put_device(folder: Path, files: Mapping[str, bytes], text: str) -> None:
    """Write the body's `files`, then the device's, whole or none of them. A file that is there as
    it would be written stays. Raises StorageError."""
    with _one:
        made = [p for p in (folder, *folder.parents) if not p.exists()]  # innermost first
        written: list[Path] = []
        try:
            with storage_errors(folder):
                folder.mkdir(parents=True, exist_ok=True)
            if (folder / DEVICE).exists():
                raise StorageError(f"{folder / DEVICE}: is there already; choose another folder")
            for name, content in files.items():
                path = folder / name
                if path.is_file() and path.read_bytes() == content:
                    continue
                if path.exists():
                    raise StorageError(f"{path}: is there already; choose another folder")
                with storage_errors(path):
                    made = [*(p for p in path.parents if not p.exists()), *made]
                    path.parent.mkdir(parents=True, exist_ok=True)
                with replace_file(path) as temporary:
                    written.append(path)
                    temporary.write_bytes(content)
            write_text(folder / DEVICE, text)
        except BaseException:
            for path in written:
                path.unlink(missing_ok=True)
            for path in made:
                with suppress(OSError):  # someone else's files may have come
                    path.rmdir()
            raise
