"""Options of the board with which cameras are calibrated."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CharucoOptions:
    """Design of a ChArUco board.

    Attributes:
        square: Set the side of a square in mm.
        columns: Set the number of squares across.
        rows: Set the number of squares down.
        dictionary: Set the dictionary of the board's tags; it must differ from that of the device's
            tags.
        marker: Set the side of a tag in mm (default: 11/15 of a square).
        printed: Describe a board that exists already: write only board.json, with nothing to print.
        inverted: Describe a board of another program that is white where ours is black, which is
            printed already.
        legacy: Describe a board drawn by OpenCV before 4.6, which starts with white if the number
            of rows is even; it is printed already.
        paper: Set the paper size: a4, letter or a3.
    """

    square: float = 30.0
    columns: int = 7
    rows: int = 5
    dictionary: str = "5X5_100"
    marker: float | None = None
    printed: bool = False
    inverted: bool = False
    legacy: bool = False
    paper: str = "a4"
