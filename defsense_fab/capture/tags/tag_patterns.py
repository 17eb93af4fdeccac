"""Patterns that cameras detect: families of square tags, and the ChArUco board.

Cameras are calibrated with the board; its file is `board.json`. Its tags are of another family
(5X5_100) than those of devices (4X4_50, APRILTAG_36H11), so a board in the image is never taken for
tags of a device, nor the other way round.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float
from ...core.errors import CaptureError
from ...core.storage.files import load_json, storage_errors, write_json
from .charuco_options import CharucoOptions

#: Names in OpenCV of each family.
FAMILIES = {
    **{f"{n}X{n}_{k}": f"DICT_{n}X{n}_{k}" for n in (4, 5, 6, 7) for k in (50, 100, 250, 1000)},
    "ARUCO_ORIGINAL": "DICT_ARUCO_ORIGINAL",
    "APRILTAG_16H5": "DICT_APRILTAG_16h5",
    "APRILTAG_25H9": "DICT_APRILTAG_25h9",
    "APRILTAG_36H10": "DICT_APRILTAG_36h10",
    "APRILTAG_36H11": "DICT_APRILTAG_36h11",
}
SCHEMA = 1
FILE = "board.json"
TAG_SHARE = 22 / 30  # side of a tag relative to that of its square
#: Pages are shrunk by at most this to fit a printer; a larger difference was measured wrongly.
MAX_PRINT_SCALE_ERROR = 0.08


@dataclass(frozen=True)
class Dictionary:
    """A family of square tags.

    Attributes:
        name: Name of the family, such as `4X4_50`.
        opencv: Number of the family in OpenCV.
        cells: Bits along each side, within a black border that is one cell wide.
        count: Number of tags.
    """

    name: str
    opencv: int
    cells: int
    count: int

    @property
    def table(self) -> cv2.aruco.Dictionary:
        """The family in OpenCV."""
        return cv2.aruco.getPredefinedDictionary(self.opencv)

    def pattern(self, number: int) -> NDArray[np.uint8]:
        """Return a tag with its border.

        Returns:
            Cells (cells + 2, cells + 2), 0 black and 255 white.

        Raises:
            CaptureError: If the family does not have the number.
        """
        if not 0 <= number < self.count:
            raise CaptureError(
                f"{self.name} has only the numbers 0 to {self.count - 1}",
                code="out-of-range",
                where=f"tag {number}",
                action="Choose a larger dictionary",
                tag=number,
                count=self.count,
            )
        cells = cv2.aruco.generateImageMarker(self.table, number, self.cells + 2, borderBits=1)
        return np.asarray(cells, np.uint8)


def dictionary(name: str) -> Dictionary:
    """Return a family of tags by its name.

    Args:
        name: Name such as `4X4_50` or `APRILTAG_36H11`, in any case, with or without `DICT_`
            (`36h11` is enough).

    Raises:
        CaptureError: If the family is unknown.
    """
    key = name.upper().removeprefix("DICT_")
    key = f"APRILTAG_{key}" if f"APRILTAG_{key}" in FAMILIES else key
    if key not in FAMILIES:
        raise CaptureError(
            "there is no such dictionary",
            code="unknown-tag-dictionary",
            where=f"dictionary {name}",
            action=(
                "Choose one of 4X4_50, 4X4_100, ... 7X7_1000, ARUCO_ORIGINAL, APRILTAG_16H5, 25H9,"
                " 36H10, 36H11"
            ),
            dictionary=name,
        )
    number = int(getattr(cv2.aruco, FAMILIES[key]))
    table = cv2.aruco.getPredefinedDictionary(number)
    return Dictionary(key, number, int(table.markerSize), len(table.bytesList))


@dataclass(frozen=True)
class CharucoBoard:
    """A board of black and white squares with tags in the white ones.

    All lengths that are derived from a board scale with its measured square.

    Attributes:
        columns: Number of squares across.
        rows: Number of squares down.
        square: Side of a square as drawn, mm; the first square (top left) is black.
        marker: Side of a tag as drawn, mm.
        dictionary: Name of the tags' family.
        measured: Side of a square as printed, mm; None if it was not measured.
        inverted: Whether black and white are exchanged, as on boards of other programs.
        legacy: Whether the board is drawn as by OpenCV before 4.6: with an even number of rows it
            starts with white.
    """

    columns: int = CharucoOptions.columns
    rows: int = CharucoOptions.rows
    square: float = CharucoOptions.square
    marker: float = TAG_SHARE * CharucoOptions.square
    dictionary: str = CharucoOptions.dictionary
    measured: float | None = None
    inverted: bool = False
    legacy: bool = False

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 100:
            raise CaptureError(
                f"{self.columns} x {self.rows} squares are not possible",
                code="board-too-small",
                where="board",
                action="Give 3 to 100 squares each way",
            )
        if not 1 <= self.square <= 1000:
            raise CaptureError(
                f"squares of {self.square:g} mm are not possible",
                code="out-of-range",
                where="board",
                action="Give 1 to 1000 mm",
            )
        cell = self.marker / (self.family.cells + 2)
        if not 0.3 * self.square <= self.marker <= self.square - 2 * 0.7 * cell:
            raise CaptureError(
                f"tags of {self.marker:g} mm do not fit in squares of {self.square:g} mm, because"
                " about one of their cells must stay white around them",
                code="board-tag-size-invalid",
                where="board",
                action=f"Use tags of about {TAG_SHARE * self.square:.1f} mm",
            )
        tags = self.columns * self.rows // 2
        if tags > self.family.count:
            raise CaptureError(
                f"{self.columns} x {self.rows} squares need {tags} tags, but {self.family.name}"
                f" has {self.family.count}",
                code="board-needs-more-tags",
                where="board",
                action="Choose fewer squares or a larger dictionary",
                count=tags,
            )
        if self.measured is None:
            return
        if not abs(self.measured / self.square - 1) <= MAX_PRINT_SCALE_ERROR:
            raise CaptureError(
                f"a square was drawn as {self.square:g} mm, but measured as {self.measured:g} mm",
                code="print-scale-wrong",
                where="board",
                action=(
                    "Print at 100 %, without fitting to the page, and measure one square in mm"
                ),
            )

    @property
    def family(self) -> Dictionary:
        """The family of its tags."""
        return dictionary(self.dictionary)

    @property
    def scale(self) -> float:
        """Scale of the print relative to the drawing; 1 if it was not measured."""
        return self.measured / self.square if self.measured else 1.0

    @property
    def charuco(self) -> cv2.aruco.CharucoBoard:
        """The board in OpenCV, mm, at the measured size."""
        board = cv2.aruco.CharucoBoard(
            (self.columns, self.rows),
            float(self.scale * self.square),
            float(self.scale * self.marker),
            self.family.table,
        )
        board.setLegacyPattern(self.legacy)
        return board

    @property
    def corners(self) -> Float:
        """Points where four squares meet, ((columns - 1) (rows - 1), 3) mm, at the measured size.

        They are in the order of OpenCV's numbers: from the top left, x to the right, y down, z = 0.
        """
        side = self.scale * self.square
        x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        return np.asarray(side * np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3))

    def measure(self, square: float) -> CharucoBoard:
        """Return the board with the side of a square as measured on the print, mm.

        Raises:
            CaptureError: If it differs by more than 8 % from the drawing.
        """
        return replace(self, measured=square)


def save_board(board: CharucoBoard, path: Path) -> None:
    """Write a board to a file.

    Raises:
        StorageError: If the file cannot be written.
    """
    with storage_errors(path):
        write_json(path, {"schema": SCHEMA, **asdict(board)})


def load_board(path: Path) -> CharucoBoard:
    """Read a board.

    Args:
        path: `board.json`, or the folder that holds it.

    Raises:
        CaptureError: If the file cannot be read or is invalid.
    """
    path = path / FILE if path.is_dir() else path
    data = load_json(path, CaptureError, "'defsense capture board' writes such a file")
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise CaptureError(
            f"is not a board of schema {SCHEMA}",
            code="not-a-board-file",
            where=path,
            action="Write the board again",
        )
    names = CharucoBoard.__dataclass_fields__
    for key in {*names, "schema"} ^ set(data):
        raise CaptureError(
            f"the key {key!r} is {'missing' if key in names else 'unknown'}",
            code="key-missing" if key in names else "unknown-key",
            where=path,
            action=f"Write the keys {', '.join(names)}",
            key=key,
        )
    for key, value in data.items():
        if not _is_valid(key, value):
            raise CaptureError(
                f"{key} cannot be {value!r}",
                code="value-invalid",
                where=path,
                action="Write the board again",
                key=key,
                value=value,
            )
    try:
        return CharucoBoard(**{k: data[k] for k in names})
    except CaptureError as error:
        raise CaptureError(
            error.problem, code=error.code, where=path, action=error.action, **error.data
        ) from None


def _is_valid(key: str, value: object) -> bool:
    """Return whether a value of `board.json` has the right type."""
    if key in ("columns", "rows"):
        return isinstance(value, int) and not isinstance(value, bool)
    if key == "dictionary":
        return isinstance(value, str)
    if key in ("inverted", "legacy"):
        return isinstance(value, bool)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number or (key == "measured" and value is None)
