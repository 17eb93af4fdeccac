"""A folder of its own in which a device is built: nothing is written to where it came from.

Builds are made of folders. Each device of this interface has one among the system's temporary
files, with a copy of its own files, which goes when the device is no longer used.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from pathlib import Path

from ..core.device.build_folder import own_files
from ..core.device.device import Device
from ..core.device.device_file import DEVICE, parse_device
from ..core.progress import Progress, silent
from ..core.storage.files import storage_errors, write_text
from .build.build import build
from .given import called
from .starts.starting_devices import put_device

_BUILD = "build"


class Workspace:
    """A temporary `folder` with device.toml, of the `text`, and what it names."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="defsense-"))
        self._gone = weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        self.text = ""

    @staticmethod
    def copy_of(source: Path, text: str, with_build: bool = True) -> Workspace:
        """The files of a device's folder, with another `text` of device.toml or the same; the
        device's build as well, of which what is up to date is reused. Raises StorageError."""
        made = Workspace()
        with storage_errors(source):
            for path in own_files(source):
                target = made.folder / path.relative_to(source)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, target)
            if with_build and (source / _BUILD).is_dir():
                shutil.copytree(
                    source / _BUILD, made.folder / _BUILD, copy_function=_link, symlinks=True
                )
        made.write(text)
        return made

    def write(self, text: str) -> None:
        """Make this the device's text. Raises StorageError."""
        write_text(self.folder / DEVICE, text)
        self.text = text

    def read(self) -> Device:
        """The device of the text. Raises DeviceError with the line and key of what is wrong."""
        return parse_device(self.text, self.folder)

    def built(self, device: Device, until: str, progress: Progress = silent) -> Path:
        """The build's folder, made as far as the stage `until`. Raises DefsenseError."""
        called(progress)
        return build(device, until, progress).folder

    def save(self, folder: Path) -> None:
        """Write the device and its own files into a folder that has none, whole or not at all.
        Raises StorageError."""
        with storage_errors(self.folder):
            files = {
                path.relative_to(self.folder).as_posix(): path.read_bytes()
                for path in own_files(self.folder)
            }
        files.pop(DEVICE, None)
        put_device(folder, files, self.text)


def _link(source: str, target: str) -> None:
    """A hard link where the file system has them: a build's files are never written again."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)
