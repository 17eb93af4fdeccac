"""Devices of the package that users can start from."""

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
from .options import EXAMPLES

_write_lock = threading.Lock()  # several users may create devices at once
_FOLDER = package_data("devices")


@dataclass(frozen=True)
class StartingDevice:
    """A device of the package.

    Attributes:
        name: Name of its folder in the package's data.
        about: Description.
    """

    name: str
    about: str

    @property
    def title(self) -> str:
        """Title on buttons."""
        return self.name.replace("-", " ").capitalize()

    @property
    def script(self) -> bytes | None:
        """The program that makes its body; None for a mesh."""
        document = tomlkit.parse((_FOLDER / self.name / DEVICE).read_text(encoding="utf-8"))
        name = document.unwrap()["body"].get("script")
        return None if name is None else (_FOLDER / self.name / name).read_bytes()

    @property
    def cord(self) -> str:
        """Name of its cord in cords.csv."""
        document = tomlkit.parse((_FOLDER / self.name / DEVICE).read_text(encoding="utf-8"))
        return str(document.unwrap()["cord"]["name"])

    @property
    def picture(self) -> bytes:
        """Its picture as PNG."""
        return (_FOLDER / f"{self.name}.png").read_bytes()


STARTING_DEVICES = tuple(StartingDevice(*example) for example in EXAMPLES.items())


def create_starting_device(
    start: StartingDevice, folder: Path, name: str, cord: str | None = None
) -> None:
    """Copy a device of the package to a folder.

    Args:
        start: The device.
        folder: The folder, which is created if needed.
        name: Name of the new device.
        cord: Name of another cord; None for that of the device.

    Raises:
        StorageError: The folder has a device or one of its files (`file-exists`), or cannot be
            written.
    """
    source = _FOLDER / start.name
    document: Any = tomlkit.parse((source / DEVICE).read_text(encoding="utf-8"))
    document["name"] = name
    if cord is not None and cord != start.cord:
        document["cord"]["name"] = cord
        document["cord"].pop("noise", None)  # it is the noise of the previous cord
    body = document["body"]
    file = str(body.get("script") or body.get("mesh"))
    content = (source / file).read_bytes()
    text = commented(tomlkit.dumps(document), DeviceFile)
    with tempfile.TemporaryDirectory(prefix="defsense-") as other:
        (Path(other) / file).touch()
        parse_device(text, Path(other))
    write_device(folder, {file: content}, text)


def write_device(folder: Path, files: Mapping[str, bytes], text: str) -> None:
    """Write the files of a body and device.toml, or none of them. Identical files are kept.

    Args:
        folder: The folder, which is created if needed.
        files: Contents of the files of the body by name.
        text: Content of device.toml.

    Raises:
        StorageError: A file exists with another content (`file-exists`), or cannot be written.
    """
    with _write_lock:
        created = [p for p in (folder, *folder.parents) if not p.exists()]  # innermost first
        written: list[Path] = []
        try:
            with storage_errors(folder):
                folder.mkdir(parents=True, exist_ok=True)
            if (folder / DEVICE).exists():
                raise _file_exists(folder / DEVICE)
            for name, content in files.items():
                path = folder / name
                if path.is_file() and path.read_bytes() == content:
                    continue
                if path.exists():
                    raise _file_exists(path)
                with storage_errors(path):
                    created = [*(p for p in path.parents if not p.exists()), *created]
                    path.parent.mkdir(parents=True, exist_ok=True)
                with replace_file(path) as temporary:
                    written.append(path)
                    temporary.write_bytes(content)
            write_text(folder / DEVICE, text)
        except BaseException:
            for path in written:
                path.unlink(missing_ok=True)
            for path in created:
                with suppress(OSError):  # others may have added files
                    path.rmdir()
            raise


def _file_exists(path: Path) -> StorageError:
    return StorageError(
        "exists already", code="file-exists", where=path, action="Choose another folder"
    )
