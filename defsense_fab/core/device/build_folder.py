"""The folder of a finished build, for those who use what it holds."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from ..errors import CaptureError, DeviceError
from ..storage.session_manifest import FILE as SESSION
from ..storage.session_manifest import OLD_FILE as OLD_SESSION
from .device import Device

# Which files of a device's folder are its own, and not results that lie beside it.

#: In a folder of results of `defsense reproduce`.
REPRODUCED = ".reproduce-lock"
#: A folder with one of these holds a recorded session, or such results.
_RESULTS = {SESSION, OLD_SESSION, REPRODUCED}
#: What builds and studies leave beside `device.toml`.
_LEFT = {"build", "study", "not-reached"}


def own_files(folder: Path, without: Path | None = None) -> Iterator[Path]:
    """Files of a device's folder and of those in it, in a fixed order: not those of builds, studies
    and experiments, of recorded sessions, hidden ones, and what Python compiled; not of a folder
    that holds the one to go `without`."""
    for where, inner, names in os.walk(folder, followlinks=True):
        here = Path(where)
        if not _RESULTS.isdisjoint(names):
            inner.clear()
            continue
        left = {"__pycache__", *(_LEFT if here == folder else ())}
        inner[:] = sorted(
            n
            for n in inner
            if n not in left and not n.startswith(".") and not _holds(here / n, here, without)
        )
        yield from (here / n for n in sorted(names) if not n.startswith("."))


def refuse_outside(device: Device) -> None:
    """Raises DeviceError for a device whose body does not go along with a copy of its folder."""
    path = device.body.path.resolve()
    if not path.is_relative_to(device.source.resolve()):
        raise DeviceError(
            f"{path}: lies outside of the device's folder, of which a copy is worked on; copy it"
            f" into {device.source}"
        )


def _holds(folder: Path, *others: Path | None) -> bool:
    """Whether one of the others lies in it, as also where a link leads back."""
    whole = folder.resolve()
    return any(o is not None and o.resolve().is_relative_to(whole) for o in others)


BUILD_AGAIN = "build the device again"


def build_folder(device: Device) -> Path:
    """Where the device's build is, whether it is there or not."""
    return device.source / "build"


def finished_build(device: Device, *needed: str) -> Path:
    """The folder of a build that has the files `needed`. Raises CaptureError where it has not."""
    folder = build_folder(device)
    if not all((folder / name).exists() for name in needed):
        raise CaptureError(f"{folder}: is not built; run 'defsense build {device.source}' first")
    return folder
