"""Families of square tags, by name."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.errors import CaptureError

#: Names in OpenCV, by ours.
FAMILIES = {
    **{f"{n}X{n}_{k}": f"DICT_{n}X{n}_{k}" for n in (4, 5, 6, 7) for k in (50, 100, 250, 1000)},
    "ARUCO_ORIGINAL": "DICT_ARUCO_ORIGINAL",
    "APRILTAG_16H5": "DICT_APRILTAG_16h5",
    "APRILTAG_25H9": "DICT_APRILTAG_25h9",
    "APRILTAG_36H10": "DICT_APRILTAG_36h10",
    "APRILTAG_36H11": "DICT_APRILTAG_36h11",
}


@dataclass(frozen=True)
class Dictionary:
    """A family of `count` tags of `cells` x `cells` bits within a black border one cell wide;
    `opencv` is its number there."""

    name: str
    opencv: int
    cells: int
    count: int

    @property
    def table(self) -> cv2.aruco.Dictionary:
        """As OpenCV has it."""
        return cv2.aruco.getPredefinedDictionary(self.opencv)

    def pattern(self, number: int) -> NDArray[np.uint8]:
        """A tag (cells + 2, cells + 2), 0 black and 255 white, the border with it. Raises
        CaptureError for a number that the family has not."""
        if not 0 <= number < self.count:
            raise CaptureError(
                f"tag {number}: {self.name} has the numbers 0 to {self.count - 1}; choose a larger"
                " dictionary",
                code="tag-number-out-of-range",
                tag=number,
                count=self.count,
            )
        made = cv2.aruco.generateImageMarker(self.table, number, self.cells + 2, borderBits=1)
        return np.asarray(made, np.uint8)


def dictionary(name: str) -> Dictionary:
    """By a name such as 4X4_50 or APRILTAG_36H11, in any case, with or without DICT_ (36h11 alone
    will do). Raises CaptureError for others."""
    key = name.upper().removeprefix("DICT_")
    key = f"APRILTAG_{key}" if f"APRILTAG_{key}" in FAMILIES else key
    if key not in FAMILIES:
        raise CaptureError(
            f"dictionary {name}: not known; there are 4X4_50, 4X4_100, ... 7X7_1000,"
            " ARUCO_ORIGINAL, APRILTAG_16H5, 25H9, 36H10, 36H11",
            code="unknown-tag-dictionary",
            dictionary=name,
        )
    number = int(getattr(cv2.aruco, FAMILIES[key]))
    table = cv2.aruco.getPredefinedDictionary(number)
    return Dictionary(key, number, int(table.markerSize), len(table.bytesList))
