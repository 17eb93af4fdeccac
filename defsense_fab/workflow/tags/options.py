"""Options of the sheets to print: a device's tags, and the board for calibrating cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...capture.tags.charuco_options import CharucoOptions as CharucoOptions

#: Folder of a device's markers, in the device folder.
MARKERS_FOLDER = "markers"
#: Dictionary of the tags of devices.
TAG_DICTIONARY = "4X4_50"


@dataclass(frozen=True)
class MarkerOptions:
    """Options of the tags of a device.

    Attributes:
        count: Set the number of tags (default: 12).
        size: Set the side of a tag's black square in mm (default: the largest of 20, 15, 12, 10, 8,
            6 that fits).
        dictionary: Set the dictionary of the tags, such as APRILTAG_36H11.
        side: Place tags only where cameras looking from this direction see them, such as 0,-1,1
            (default: all around).
        skin: Choose places on the skin even if the device has seats.
        paper: Set the paper size: a4, letter or a3.
        out: Set the output folder (default: markers, in the device folder).
    """

    count: int | None = None
    size: float | None = None
    dictionary: str = TAG_DICTIONARY
    side: tuple[float, float, float] | None = None
    skin: bool = False
    paper: str = "a4"
    out: Path | None = None
