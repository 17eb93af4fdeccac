"""Sheets of tags and boards to print at true scale, as PDF.

Lengths are mm from the lower left of the page. A tag is upright on the sheet. The piece to cut out
is its square with white around it, one cell wide. The tag's number is below the piece, because in
the white it would disturb the detector.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Bool
from ...core.errors import CaptureError
from ...core.storage.files import replace_file
from .tag_patterns import CharucoBoard, Dictionary

#: Width and height of upright paper, mm.
PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4), "a3": (297.0, 420.0)}
RULER_MM = 100.0
POINTS_PER_MM = 72 / 25.4
MIN_EDGE_MM = 10.0  # from the edge to the corner crosses, which every printer reaches
LEFT_MM, RIGHT_MM, BOTTOM_MM, TOP_MM = 28.0, 14.0, 29.0, 30.0  # margins
GAP_MM = (7.0, 9.0)  # between pieces, across and down
MARK_GREY, MARK_MM = 0.6, 2.5  # shade and length of cut marks
NUMBER_MM = 7.0  # room for the uppermost marks and the lowest numbers
_TAGS_HINT = (
    "Cut along the grey marks; the white stays on the tag, and its number is below it. Cut and glue"
    " one at a time."
)
_BOARD_HINT = (
    "Glue it flat on a stiff plate; measure several squares in a row with a caliper, divide, and"
    " store the length of one: defsense capture board --measured MM"
)
_Corner = tuple[int, int]


def piece_size(tags: Dictionary, size: float) -> float:
    """Return the side of the piece to cut out, mm: a tag of `size` mm with a white cell around."""
    return size * (tags.cells + 4) / (tags.cells + 2)


@contextmanager
def open_pdf(path: Path, title: str) -> Iterator[Any]:
    """Open a reportlab canvas, which is saved at the end; viewers print it at 100 % by default.

    Raises:
        StorageError: If the file cannot be written.
    """
    from reportlab.pdfgen.canvas import Canvas

    with replace_file(path) as temporary:
        canvas = Canvas(str(temporary), invariant=1)
        canvas.setTitle(title)
        canvas.setAuthor("defsense-fab")
        canvas.setViewerPreference("PrintScaling", "None")
        yield canvas
        canvas.save()


def paper_size(name: str) -> tuple[float, float]:
    """Return width and height of upright paper, mm.

    Raises:
        CaptureError: If the paper is unknown.
    """
    if name.lower() not in PAPERS:
        raise CaptureError(
            "is not a known paper",
            code="unknown-paper",
            where=f"paper {name}",
            action=f"Choose one of {', '.join(PAPERS)}",
            papers=tuple(PAPERS),
        )
    return PAPERS[name.lower()]


def draw_tags(
    canvas: Any, tags: Dictionary, numbers: Sequence[int], size: float, paper: str, title: str
) -> None:
    """Draw tags on as many pages as they need.

    Args:
        canvas: Canvas of `open_pdf`.
        tags: Family of the tags.
        numbers: Numbers of the tags.
        size: Side of the black squares, mm.
        paper: Name of the paper.
        title: Title of the sheets.

    Raises:
        CaptureError: If a tag is larger than the paper, or the family does not have a number.
    """
    width, height = paper_size(paper)
    side = piece_size(tags, size)
    room = np.array([width - LEFT_MM - RIGHT_MM, height - BOTTOM_MM - TOP_MM - NUMBER_MM])
    across, down = (int((r + g) // (side + g)) for r, g in zip(room, GAP_MM, strict=True))
    if across < 1 or down < 1 or size <= 0:
        raise CaptureError(
            f"tags of {size:g} mm with their white do not fit on {paper}",
            code="print-too-large",
            where="tags",
            action="Choose smaller tags or larger paper",
        )
    pages = [numbers[i : i + across * down] for i in range(0, len(numbers), across * down)]
    for n, page in enumerate(pages):
        _start_page(canvas, width, height)
        count = f", sheet {n + 1} of {len(pages)}" if len(pages) > 1 else ""
        _draw_frame(canvas, width, height, f"{title}: tags of {size:g} mm, {tags.name}{count}")
        _draw_text(canvas, LEFT_MM, height - 26, _TAGS_HINT, 8.5)
        for k, number in enumerate(page):
            x = LEFT_MM + k % across * (side + GAP_MM[0])
            y = height - TOP_MM - MARK_MM - side - k // across * (side + GAP_MM[1])
            _draw_tag(canvas, tags, number, (x, y), size)
        canvas.showPage()


def write_board(board: CharucoBoard, path: Path, paper: str = "a4") -> None:
    """Write a board at its nominal size; the paper is turned to fit.

    Raises:
        CaptureError: If the board does not fit on the paper.
        StorageError: If the file cannot be written.
    """
    width, height = _fitting_page(board, paper)
    across, down = board.columns * board.square, board.rows * board.square
    title = (
        f"ChArUco board, {board.columns} x {board.rows} squares of {board.square:g} mm, tags of"
        f" {board.marker:g} mm, {board.family.name}"
    )
    with open_pdf(path, title) as canvas:
        _start_page(canvas, width, height)
        _draw_frame(canvas, width, height, title)
        _draw_text(canvas, LEFT_MM, height - 26, _BOARD_HINT, 8.5)
        left = max(LEFT_MM, (width - across) / 2)
        bottom = BOTTOM_MM + (height - BOTTOM_MM - TOP_MM - down) / 2
        black = np.indices((board.rows, board.columns)).sum(0) % 2 == 0
        _draw_cells(canvas, black, (left, bottom), board.square)
        nominal = CharucoBoard(
            board.columns, board.rows, board.square, board.marker, board.dictionary
        )
        charuco = nominal.charuco
        for number, corners in zip(charuco.getIds(), charuco.getObjPoints(), strict=True):
            x, y = np.min(corners, axis=0)[0], np.max(corners, axis=0)[1]
            pattern = board.family.pattern(int(number)) == 0
            cell = board.marker / len(pattern)
            _draw_cells(canvas, pattern, (left + float(x), bottom + down - float(y)), cell)
        canvas.showPage()


def _fitting_page(board: CharucoBoard, paper: str) -> tuple[float, float]:
    """Return the paper's width and height, mm, turned so that the board fits."""
    upright = paper_size(paper)
    is_wide = board.columns >= board.rows
    largest = 0.0
    for width, height in (upright[::-1], upright) if is_wide else (upright, upright[::-1]):
        side = min(
            (width - LEFT_MM - RIGHT_MM) / board.columns,
            (height - BOTTOM_MM - TOP_MM) / board.rows,
        )
        if side >= board.square - 1e-9:
            return width, height
        largest = max(largest, side)
    fitting_square = float(np.floor(2 * largest) / 2)
    raise CaptureError(
        f"{board.columns} x {board.rows} squares of {board.square:g} mm do not fit on {paper} with"
        " its margins and rulers",
        code="print-too-large",
        where="board",
        action=f"Use squares of {fitting_square:g} mm, fewer squares or larger paper",
        square=fitting_square,
    )


def _start_page(canvas: Any, width: float, height: float) -> None:
    canvas.setPageSize((width * POINTS_PER_MM, height * POINTS_PER_MM))
    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)


def _draw_frame(canvas: Any, width: float, height: float, title: str) -> None:
    """Draw the title, corner crosses at known distances, and two rulers."""
    across, down = (10 * ((n - 2 * MIN_EDGE_MM) // 10) for n in (width, height))
    left, bottom = (width - across) / 2, (height - down) / 2
    canvas.setStrokeGray(0)
    canvas.setLineWidth(0.2)
    for x in (left, left + across):
        for y in (bottom, bottom + down):
            canvas.line(x - 2.5, y, x + 2.5, y)
            canvas.line(x, y - 2.5, x, y + 2.5)
    _draw_text(canvas, LEFT_MM, height - 17, title, 11, bold=True)
    check = (
        "Print at 100 %, without 'fit to page'. Both rulers must be"
        f" {RULER_MM:g} mm, the corner crosses {across:g} mm apart across and {down:g} mm down."
    )
    _draw_text(canvas, LEFT_MM, height - 21.5, check, 8.5)
    _draw_ruler(canvas, (LEFT_MM, 17.0), upright=False)
    _draw_ruler(canvas, (19.0, BOTTOM_MM), upright=True)
    _draw_text(canvas, LEFT_MM + RULER_MM + 4, 17.5, "this line must be 100 mm", 8.5)


def _draw_ruler(canvas: Any, corner: tuple[float, float], upright: bool) -> None:
    """Draw a line of 100 mm with ticks; it ends in the middle of its outer ticks."""
    canvas.saveState()
    canvas.translate(*corner)
    if upright:
        canvas.rotate(90)
    canvas.setStrokeGray(0)
    canvas.setLineWidth(0.2)
    canvas.line(0, 0, RULER_MM, 0)
    for k in range(int(RULER_MM) + 1):
        canvas.line(k, 0, k, 5 if k % 10 == 0 else 3.5 if k % 5 == 0 else 2)
        if k % 10 == 0:
            canvas.setFont("Helvetica", 6 / POINTS_PER_MM)
            canvas.drawCentredString(k, 5.7, str(k))
    canvas.restoreState()


def _draw_tag(
    canvas: Any, tags: Dictionary, number: int, corner: tuple[float, float], size: float
) -> None:
    """Draw a tag whose piece has its lower left corner at `corner`."""
    pattern = tags.pattern(number) == 0
    cell = size / len(pattern)
    (x, y), side = corner, size + 2 * cell
    _draw_cells(canvas, pattern, (x + cell, y + cell), cell)
    canvas.setStrokeGray(MARK_GREY)
    canvas.setLineWidth(0.12)
    for cx, dx in ((x, -1), (x + side, 1)):
        for cy, dy in ((y, -1), (y + side, 1)):
            canvas.line(cx + 0.5 * dx, cy, cx + MARK_MM * dx, cy)
            canvas.line(cx, cy + 0.5 * dy, cx, cy + MARK_MM * dy)
    canvas.setFillGray(0)
    canvas.setFont("Helvetica-Bold", 9 / POINTS_PER_MM)
    canvas.drawCentredString(x + side / 2, y - 3.8, str(number))


def _draw_cells(canvas: Any, black: Bool, corner: tuple[float, float], cell: float) -> None:
    """Draw black cells as one filled region, the pattern's lower left at `corner`.

    Cells drawn one by one leave hairlines between them where a raster's pixels do not meet their
    edges; one region with one outline has none.
    """
    path = canvas.beginPath()
    top = corner[1] + len(black) * cell
    for polygon in outlines(black):
        for k, (column, row) in enumerate(polygon):
            (path.lineTo if k else path.moveTo)(corner[0] + column * cell, top - row * cell)
        path.close()
    canvas.setFillGray(0)
    canvas.drawPath(path, stroke=0, fill=1, fillMode=0)


def _draw_text(
    canvas: Any, x: float, y: float, text: str, points: float, bold: bool = False
) -> None:
    canvas.setFillGray(0)
    canvas.setFont("Helvetica-Bold" if bold else "Helvetica", points / POINTS_PER_MM)
    canvas.drawString(x, y, text)


def outlines(black: Bool) -> list[list[_Corner]]:
    """Return closed polygons around the black cells of a pattern.

    Args:
        black: Whether each cell is black (rows, columns), rows downwards.

    Returns:
        Corners (column, row) of each polygon, only where it turns. Filled by the even-odd rule,
        the polygons give the cells.
    """
    padded = np.pad(black, 1)
    ends_from: dict[_Corner, list[_Corner]] = {}
    for row, column in np.argwhere(padded).tolist():
        x, y = column - 1, row - 1
        for (dr, dc), start, end in (
            ((-1, 0), (x, y), (x + 1, y)),
            ((0, 1), (x + 1, y), (x + 1, y + 1)),
            ((1, 0), (x + 1, y + 1), (x, y + 1)),
            ((0, -1), (x, y + 1), (x, y)),
        ):
            if not padded[row + dr, column + dc]:
                ends_from.setdefault(start, []).append(end)
    polygons = []
    while ends_from:
        first = next(iter(ends_from))
        line, corner = [first], _take_next(ends_from, first)
        while corner != first:
            line.append(corner)
            corner = _take_next(ends_from, corner)
        polygons.append(_turning_corners(line))
    return polygons


def _take_next(ends_from: dict[_Corner, list[_Corner]], corner: _Corner) -> _Corner:
    """Remove and return the end of an edge that starts at a corner."""
    ends = ends_from[corner]
    end = ends.pop()
    if not ends:
        del ends_from[corner]
    return end


def _turning_corners(line: list[_Corner]) -> list[_Corner]:
    ring = zip([line[-1], *line[:-1]], line, [*line[1:], line[0]], strict=True)
    return [b for a, b, c in ring if (b[0] - a[0]) * (c[1] - b[1]) != (b[1] - a[1]) * (c[0] - b[0])]
