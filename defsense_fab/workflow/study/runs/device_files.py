"""A device's folder as bytes, which is all that a run needs of this machine's disk."""

from __future__ import annotations

import hashlib
import io
import zipfile
from dataclasses import dataclass
from pathlib import Path

from ....core.device.build_folder import own_files
from ....core.device.device_file import DEVICE
from ....core.errors import StudyError
from ....core.storage.files import storage_errors
from ..points.study_toml import FILE as STUDY

_MOST = 500e6  # bytes
_WHEN = (2000, 1, 1, 0, 0, 0)  # of all files, so that the same files are the same bytes


@dataclass(frozen=True)
class DeviceFiles:
    """A ZIP `archive` of the files, and the `digest` of what they contain: of all but the two that
    say what is made of them."""

    archive: bytes
    digest: str


def pack(folder: Path) -> DeviceFiles:
    """All files of a device's folder but results, recorded sessions and hidden ones. Raises
    StudyError where they are too many bytes, StorageError where one cannot be read."""
    contents, size = {}, 0
    for path in filter(Path.is_file, own_files(folder)):
        with storage_errors(path):
            size += path.stat().st_size
            if size > _MOST:
                raise StudyError(
                    f"{folder}: holds more than {_MOST / 1e6:.0f} MB besides its results, which"
                    " every batch of runs would be sent; move away what the body is not made of"
                )
            contents[path.relative_to(folder).as_posix()] = path.read_bytes()
    out, told = io.BytesIO(), hashlib.sha256()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in sorted(contents.items()):
            archive.writestr(zipfile.ZipInfo(name, _WHEN), data, zipfile.ZIP_DEFLATED)
            if name not in (DEVICE, STUDY):
                told.update(f"{name}\0{len(data)}\0".encode() + data)
    return DeviceFiles(out.getvalue(), told.hexdigest()[:16])


def unpack(archive: bytes, folder: Path) -> None:
    """Into a new folder. Raises StorageError."""
    with storage_errors(folder), zipfile.ZipFile(io.BytesIO(archive)) as files:
        files.extractall(folder)
