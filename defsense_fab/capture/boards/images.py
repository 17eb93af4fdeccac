"""Compiled firmware of read-out boards, as it comes with the package."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.errors import CaptureError
from ...core.storage.package_data import package_data
from ...sensing.serial_frames import PROTOCOL, Info
from .intel_hex import read_intel_hex

IMAGES_FOLDER = package_data("arduino") / "images"


@dataclass(frozen=True)
class FirmwareImage:
    """Compiled firmware for a board and a converter.

    Attributes:
        file: Name of its file in `firmware/images`.
        converter: `Info.converter` of a board that runs it.
        channels: Number of channels; None if the connected converters decide.
    """

    file: str
    converter: int
    channels: int | None = None

    def read(self) -> bytes:
        """Return the contents of the flash memory from address 0."""
        return read_intel_hex(IMAGES_FOLDER / self.file)

    def runs_on(self, installed: Info) -> bool:
        """Return whether a board runs this firmware, in this or a later version."""
        if installed.is_outdated:
            return False
        if installed.protocol > PROTOCOL:  # its other fields are unknown
            return True
        return installed.converter == self.converter and self.channels in (
            None,
            installed.most_channels,
        )


_ADS1115 = FirmwareImage("ads1115.hex", converter=1)  # the same code on both boards
#: By board and converter.
IMAGES = {
    ("nano", "arduino"): FirmwareImage("divider-nano.hex", converter=0, channels=8),
    ("uno", "arduino"): FirmwareImage("divider-uno.hex", converter=0, channels=6),
    ("nano", "ads1115"): _ADS1115,
    ("uno", "ads1115"): _ADS1115,
}


def find_image(board: str, converter: str) -> FirmwareImage:
    """Return the firmware for a board and a converter.

    Args:
        board: "nano" or "uno".
        converter: "arduino" for the microcontroller's own, or "ads1115".

    Raises:
        CaptureError: The board has no image for the converter (`image-missing`).
    """
    image = IMAGES.get((board, converter))
    if image is None:
        raise CaptureError(
            f"there is no compiled firmware for the board {board} with the converter {converter}",
            code="image-missing",
            action="Choose the board nano or uno, and the converter arduino or ads1115; a board"
            " with MicroPython gets its program from 'defsense board micropython'",
            board=board,
            converter=converter,
        )
    return image
