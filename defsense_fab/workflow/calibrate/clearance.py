"""Write the clearance that a fit coupon showed into a device."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ...core.device.device import FabricationSpec
from ...core.device.device_file import DEVICE, load_device, parse_device
from ...core.errors import DeviceError
from ...core.storage.files import storage_errors, write_text
from .calibration_parts import NO_MOULD

MAX_CLEARANCE_MM = 1.5


@dataclass(frozen=True)
class Clearance:
    """Change of a device's clearance.

    Attributes:
        file: The file that was written.
        written: Clearance that the file gave before, mm; None if it gave none.
        was: Clearance of the device before, mm.
        now: Clearance that the file gives now, mm; None for that of the process.
        fabrication: Fabrication of the device now.
    """

    file: Path
    written: float | None
    was: float
    now: float | None
    fabrication: FabricationSpec

    @property
    def note(self) -> str:
        """Note on a clearance that the process does not use as the coupon; empty if none."""
        is_cast = self.fabrication.kind == "cast" and self.now is not None
        return f"{self.fabrication.process} {NO_MOULD}" if is_cast else ""


def write_clearance(folder: Path, fits: float | None) -> Clearance:
    """Set or remove [fabrication] clearance in a `device.toml`; comments and order stay.

    Args:
        folder: Folder of the device.
        fits: Clearance on the diameter, mm; None to use that of the process again.

    Returns:
        The change.

    Raises:
        DeviceError: The file is invalid, before or after, or no printer needs such a clearance.
        StorageError: The file cannot be written.
    """
    path = folder / DEVICE
    before = load_device(folder, complete=False).fabrication
    if fits is not None and not 0 <= fits <= MAX_CLEARANCE_MM:
        raise DeviceError(
            f"{fits:g} mm is not between 0 and {MAX_CLEARANCE_MM:g} mm",
            code="out-of-range",
            where="clearance",
            action="Give the number next to the groove that fits, in mm on the diameter",
            value=fits,
        )
    with storage_errors(folder):
        text = path.read_bytes().decode("utf-8")  # line ends stay
        try:
            document = tomlkit.parse(text)
        except TOMLKitError as error:
            raise DeviceError(
                f"is not valid TOML ({error})",
                code="toml-invalid",
                where=path,
                action="Correct it in an editor",
            ) from None
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
