"""Folders of a device: the folder of its build, and the sources in its own folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from ..errors import CaptureError, DeviceError
from ..storage.session_manifest import FILE as SESSION
from .device import Device

#: File in a folder with results of `defsense reproduce`.
REPRODUCED = ".reproduce-lock"
#: Action for build files that are missing or damaged.
BUILD_AGAIN = "Build the device again"
#: A folder with one of these files is a recorded session, or has results.
_RESULT_MARKS = {SESSION, REPRODUCED}
#: Folders that builds and studies create next to `device.toml`.
_RESULT_FOLDERS = {"build", "study", "not-reached"}


def own_files(folder: Path, without: Path | None = None) -> Iterator[Path]:
    """Yield a device's own files, in a fixed order.

    Results of builds, studies and experiments, recorded sessions, hidden files and compiled Python
    files are omitted.

    Args:
        folder: Folder of the device.
        without: A folder to omit, with the folders that contain it.
    """
    for current, folders, names in os.walk(folder, followlinks=True):
        here = Path(current)
        if not _RESULT_MARKS.isdisjoint(names):
            folders.clear()
            continue
        omitted = {"__pycache__", *(_RESULT_FOLDERS if here == folder else ())}
        folders[:] = sorted(
            n
            for n in folders
            if n not in omitted and not n.startswith(".") and not _contains(here / n, here, without)
        )
        yield from (here / n for n in sorted(names) if not n.startswith("."))


def refuse_outside(device: Device) -> None:
    """Check that a copy of a device's folder includes its body.

    Raises:
        DeviceError: The body's file is outside of the folder.
    """
    path = device.body.path.resolve()
    if not path.is_relative_to(device.source.resolve()):
        raise DeviceError(
            "is outside of the device's folder, which is copied",
            code="file-outside-folder",
            where=path,
            action=f"Copy it to {device.source}",
            path=path,
        )


def _contains(folder: Path, *others: Path | None) -> bool:
    """Return whether a folder contains one of the others, as a link back to a parent does."""
    resolved = folder.resolve()
    return any(o is not None and o.resolve().is_relative_to(resolved) for o in others)


def build_folder(device: Device) -> Path:
    """Return the folder of a device's build, which need not exist."""
    return device.source / "build"


def finished_build(device: Device, *required: str) -> Path:
    """Return the folder of a build that has some files.

    Args:
        device: The device.
        *required: Names of the files.

    Raises:
        CaptureError: A file is missing.
    """
    folder = build_folder(device)
    if not all((folder / name).exists() for name in required):
        raise CaptureError(
            "is not a finished build",
            code="not-built",
            where=folder,
            action=f"Run 'defsense build {device.source}' first",
            path=folder,
        )
    return folder
