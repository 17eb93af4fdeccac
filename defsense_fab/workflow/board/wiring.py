"""The wiring of a built device: its drawing, its file for WireViz, and its tables."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.device.build_folder import finished_build
from ...core.device.device import Device
from ...core.errors import DeviceError
from ...core.storage.files import storage_errors, write_text
from ...report.guide.tables import GuideTable, wiring_tables
from ...report.wiring.connections import Wiring, plan_wiring
from ...report.wiring.drawing import draw_wiring
from ...report.wiring.wireviz import wireviz_file
from ...store.manifest import MANIFEST, Manifest, load_manifest
from .options import WiringOptions

#: Files of the wiring. The second is not named as the first, as WireViz writes an SVG of its name.
DRAWING, HARNESS = "wiring.svg", "wireviz.yml"
_FOLDER = "wiring"
_DEFAULT_OPTIONS = WiringOptions()


@dataclass(frozen=True)
class WiringFiles:
    """The wiring of a device, and the files that were written.

    Attributes:
        wiring: The wiring.
        tables: Tables of the wires of each cord, and of all other wires.
        drawing: The drawing, an SVG file.
        harness: The file for WireViz.
    """

    wiring: Wiring
    tables: tuple[GuideTable, GuideTable]
    drawing: Path
    harness: Path


def write_wiring(device: Device, options: WiringOptions = _DEFAULT_OPTIONS) -> WiringFiles:
    """Write the wiring of a built device.

    Args:
        device: The device, whose build has parts.
        options: Another board or converter, and the folder for the files.

    Raises:
        CaptureError: The device is not built (`not-built`).
        DeviceError: The board has another converter (`converter-not-on-board`), or too few
            channels (`too-many-cords`), or the device has no cords (`no-cords`).
        StorageError: A file cannot be written.
    """
    manifest = load_manifest(finished_build(device, MANIFEST))
    wiring = plan_wiring(device, manifest, options.board, options.converter)
    folder = options.out or device.source / _FOLDER
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_wiring_files(wiring, folder)
    return WiringFiles(wiring, wiring_tables(wiring), folder / DRAWING, folder / HARNESS)


def write_wiring_files(wiring: Wiring, folder: Path) -> None:
    """Write the drawing and the file for WireViz to an existing folder.

    Raises:
        StorageError: A file cannot be written.
    """
    for name, text in ((DRAWING, draw_wiring(wiring)), (HARNESS, wireviz_file(wiring))):
        with storage_errors(folder / name):
            write_text(folder / name, text)


def plan_if_possible(device: Device, manifest: Manifest) -> tuple[Wiring | None, tuple[str, ...]]:
    """Plan the wiring for the device's board, whether or not the board can read all cords.

    Args:
        device: The device.
        manifest: The manifest of its parts.

    Returns:
        The wiring, or None without cords or with too many; and notes on why it is not possible.
    """
    if not manifest.cords:
        return None, ()
    try:
        return plan_wiring(device, manifest), ()
    except DeviceError as error:
        return None, (str(error),)
