"""The clearance that a coupon showed, written into a device."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ..core.device.device import FabricationSpec
from ..core.device.device_file import DEVICE, load_device, parse_device
from ..core.errors import DeviceError
from ..core.storage.files import storage_errors, write_text

LARGEST = 1.5  # mm


@dataclass(frozen=True)
class Clearance:
    """The file that was written; what it said of the clearance before, mm (None: nothing, so that
    `was` is the process's), and what it says now."""

    file: Path
    written: float | None
    was: float
    now: float | None
    fabrication: FabricationSpec


def write_clearance(folder: Path, fits: float | None) -> Clearance:
    """Set [fabrication] clearance (mm, on the diameter) in the folder's `device.toml`, or remove it
    where `fits` is None, so that the process's counts again. Comments and order stay.

    Raises DeviceError for a file that is no device, before or after, and for a clearance that no
    printer needs.
    """
    path = folder / DEVICE
    before = load_device(folder, complete=False).fabrication
    if fits is not None and not 0 <= fits <= LARGEST:
        raise DeviceError(
            f"--fits {fits:g}: is the number beside the groove that fits, in mm on the diameter,"
            f" from 0 to {LARGEST:g}"
        )
    with storage_errors(folder):
        text = path.read_bytes().decode("utf-8")  # line ends stay
        try:
            document = tomlkit.parse(text)
        except TOMLKitError as error:
            raise DeviceError(f"{path}: not valid TOML: {error}") from None
        table = document.setdefault("fabrication", tomlkit.table())
        written = table.get("clearance")
        if fits is None:
            table.pop("clearance", None)
        else:
            table["clearance"] = fits
        changed = tomlkit.dumps(document)
        after = parse_device(changed, folder, complete=False).fabrication
        if changed != text:
            write_text(path, changed)
    return Clearance(
        path, None if written is None else float(written), before.clearance, fits, after
    )
