"""Write the board with which cameras are calibrated, and store its measured size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...capture.tags.print_sheets import write_board as draw_board
from ...capture.tags.tag_patterns import FILE, TAG_SHARE, CharucoBoard, load_board, save_board
from ...core.errors import CaptureError
from ...core.storage.files import storage_errors
from .options import CharucoOptions

DEFAULT_OPTIONS = CharucoOptions()


@dataclass(frozen=True)
class BoardFiles:
    """Files of a board.

    Attributes:
        board: The board.
        file: Its `board.json`.
        sheet: The page to print; None for a board that is printed already.
        lost_measurement: Whether the file had the measured size of an earlier print.
    """

    board: CharucoBoard
    file: Path
    sheet: Path | None = None
    lost_measurement: bool = False


def write_board(folder: Path, options: CharucoOptions = DEFAULT_OPTIONS) -> BoardFiles:
    """Write `board.json`, and `board.pdf` unless the board is printed already.

    Args:
        folder: Folder of the files.
        options: Design of the board.

    Raises:
        CaptureError: There is no such board, or it does not fit on the paper.
        StorageError: Files cannot be written.
    """
    board = CharucoBoard(
        options.columns,
        options.rows,
        options.square,
        round(TAG_SHARE * options.square, 1) if options.marker is None else options.marker,
        options.dictionary,
        inverted=options.inverted,
        legacy=options.legacy,
    )
    is_printed = options.printed or options.inverted or options.legacy
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    file = folder / FILE
    had_measurement = file.is_file() and _is_measured(file)
    sheet = None if is_printed else file.with_suffix(".pdf")
    if sheet is not None:
        draw_board(board, sheet, options.paper)
    save_board(board, file)
    return BoardFiles(board, file, sheet, had_measurement)


def store_measurement(folder: Path, square: float) -> BoardFiles:
    """Store the side of a square as measured on the print.

    Args:
        folder: Folder of the board.
        square: Side of a square, mm.

    Raises:
        CaptureError: The board cannot be read, or the size differs too much from the drawing
            (`print-scale-wrong`).
        StorageError: The file cannot be written.
    """
    file = folder / FILE
    board = load_board(file).measure(square)
    save_board(board, file)
    return BoardFiles(board, file)


def _is_measured(file: Path) -> bool:
    try:
        return load_board(file).measured is not None
    except CaptureError:
        return False
