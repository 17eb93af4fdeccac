"""The ChArUco board that cameras are calibrated with, and its file, `board.json`.

Its tags are of another family (5X5_100) than those of devices (4X4_50, APRILTAG_36H11): a board in
the picture is never taken for tags of the device, nor the other way round.
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

# Families of square tags, by name.

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


SCHEMA = 1
FILE = "board.json"
#: Of a tag's side to that of its square.
MARKER = 22 / 30
_OFF = 0.08  # what pages are shrunk by to fit others; more was measured wrongly


@dataclass(frozen=True)
class CharucoBoard:
    """`columns` x `rows` squares of `square` mm as drawn, the first (top left) black, with tags of
    `marker` mm in the white ones; `measured`, mm, is a square as printed, None until someone
    measured it. Everything in mm that is made of a board scales by it. Boards of other programs may
    be `inverted`, black and white exchanged, or `legacy`, as OpenCV drew them before 4.6: with an
    even number of rows they begin with white."""

    columns: int = 7
    rows: int = 5
    square: float = 30.0
    marker: float = 22.0
    dictionary: str = "5X5_100"
    measured: float | None = None
    inverted: bool = False
    legacy: bool = False

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 100:
            raise CaptureError(
                f"board: {self.columns} x {self.rows} squares; give at least 3 each way",
                code="board-too-small",
            )
        if not 1 <= self.square <= 1000:
            raise CaptureError(
                f"board: squares of {self.square:g} mm; give 1 to 1000",
                code="square-size-out-of-range",
            )
        cell = self.marker / (self.family.cells + 2)
        if not 0.3 * self.square <= self.marker <= self.square - 2 * 0.7 * cell:
            raise CaptureError(
                f"board: tags of {self.marker:g} mm in squares of {self.square:g} mm; white of"
                f" about one of their cells must be left; {MARKER * self.square:.1f} mm is good",
                code="board-tag-size-invalid",
            )
        tags = self.columns * self.rows // 2
        if tags > self.family.count:
            raise CaptureError(
                f"board: {self.columns} x {self.rows} squares need {tags} tags, {self.family.name}"
                f" has {self.family.count}; take fewer squares or a larger dictionary",
                code="board-needs-more-tags",
                count=tags,
            )
        if self.measured is not None and not abs(self.measured / self.square - 1) <= _OFF:
            raise CaptureError(
                f"board: a square measured as {self.measured:g} mm and drawn as {self.square:g} mm;"
                " print at 100 %, without fitting to the page, and measure one square (in mm)",
                code="print-scale-wrong",
            )

    @property
    def family(self) -> Dictionary:
        """Of its tags."""
        return dictionary(self.dictionary)

    @property
    def scale(self) -> float:
        """Of the print to the drawing; 1 where nobody measured."""
        return self.measured / self.square if self.measured else 1.0

    @property
    def charuco(self) -> cv2.aruco.CharucoBoard:
        """As OpenCV has it, mm, at the measured size."""
        made = cv2.aruco.CharucoBoard(
            (self.columns, self.rows),
            float(self.scale * self.square),
            float(self.scale * self.marker),
            self.family.table,
        )
        made.setLegacyPattern(self.legacy)
        return made

    @property
    def corners(self) -> Float:
        """Where four squares meet, ((columns - 1) (rows - 1), 3) mm at the measured size, by
        OpenCV's numbers: from the top left, x to the right, y down, z = 0."""
        side = self.scale * self.square
        x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        return np.asarray(side * np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3))

    def measure(self, square: float) -> CharucoBoard:
        """The same with the `square`, mm, as measured on the print. Raises CaptureError where that
        is off by more than 8 %."""
        return replace(self, measured=square)


def save_board(board: CharucoBoard, path: Path) -> None:
    """Raises StorageError where it cannot be written."""
    with storage_errors(path):
        write_json(path, {"schema": SCHEMA, **asdict(board)})


def load_board(path: Path) -> CharucoBoard:
    """Of `board.json`, or of the folder that holds it. Raises CaptureError with the file."""
    path = path / FILE if path.is_dir() else path
    data = load_json(path, CaptureError, "'defsense capture board' writes such a file")
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise CaptureError(
            f"{path}: not a board of schema {SCHEMA}; write it anew", code="not-a-board-file"
        )
    wanted = CharucoBoard.__dataclass_fields__
    data = {"inverted": False, "legacy": False, **data}  # which older files do not have
    for key in {*wanted, "schema"} ^ set(data):
        said = "is missing" if key in wanted else "is not known"
        raise CaptureError(
            f"{path}: {key!r} {said}; there are {', '.join(wanted)}",
            code="key-missing" if key in wanted else "unknown-key",
            key=key,
        )
    for key, value in data.items():
        if key in ("columns", "rows"):
            good = isinstance(value, int) and not isinstance(value, bool)
        elif key == "dictionary":
            good = isinstance(value, str)
        elif key in ("inverted", "legacy"):
            good = isinstance(value, bool)
        else:
            number = isinstance(value, int | float) and not isinstance(value, bool)
            good = number or (key == "measured" and value is None)
        if not good:
            raise CaptureError(
                f"{path}: {key} cannot be {value!r}", code="value-invalid", key=key, value=value
            )
    try:
        return CharucoBoard(**{k: data[k] for k in wanted})
    except CaptureError as error:
        raise CaptureError(f"{path}: {error}", code=error.code, **error.data) from None
