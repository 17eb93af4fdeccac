"""Sheets of tags and boards to print, at true scale, as PDF.

Lengths are mm from the lower left of the page. A tag's picture is upright on the sheet, and what is
cut out is its square with white around it, one cell wide; its number stands below, on what is cut
off, because in the white it would disturb the detector.
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

# The outlines of a picture of black and white cells.
#
# Cells drawn one by one leave hairlines between them where a raster's pixels do not meet their edges;
# one region with one outline has none.

Corner = tuple[int, int]


def outlines(black: Bool) -> list[list[Corner]]:
    """Closed polygons of corners (column, row) around the black cells of a picture (rows, columns),
    rows downwards, corners only where they turn. Filled by the even-odd rule they give the cells.
    """
    padded = np.pad(black, 1)
    follow: dict[Corner, list[Corner]] = {}
    for row, column in np.argwhere(padded).tolist():
        x, y = column - 1, row - 1
        for (dr, dc), start, end in (
            ((-1, 0), (x, y), (x + 1, y)),
            ((0, 1), (x + 1, y), (x + 1, y + 1)),
            ((1, 0), (x + 1, y + 1), (x, y + 1)),
            ((0, -1), (x, y + 1), (x, y)),
        ):
            if not padded[row + dr, column + dc]:
                follow.setdefault(start, []).append(end)
    found = []
    while follow:
        first = next(iter(follow))
        line, at = [first], _next(follow, first)
        while at != first:
            line.append(at)
            at = _next(follow, at)
        found.append(_turns(line))
    return found


def _next(follow: dict[Corner, list[Corner]], at: Corner) -> Corner:
    ways = follow[at]
    way = ways.pop()
    if not ways:
        del follow[at]
    return way


def _turns(line: list[Corner]) -> list[Corner]:
    ring = zip([line[-1], *line[:-1]], line, [*line[1:], line[0]], strict=True)
    return [b for a, b, c in ring if (b[0] - a[0]) * (c[1] - b[1]) != (b[1] - a[1]) * (c[0] - b[0])]


#: Width and height upright, mm.
PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4), "a3": (297.0, 420.0)}
RULER = 100.0
_MM = 72 / 25.4  # points
_EDGE = 10.0  # to the corner crosses at least, which every printer reaches
_LEFT, _RIGHT, _BOTTOM, _TOP = 28.0, 14.0, 29.0, 30.0  # of what is printed
_GAP = (7.0, 9.0)  # between what is cut out, across and down
_GREY, _MARK = 0.6, 2.5  # of cut marks: shade and reach
_NUMBER = 7.0  # for the uppermost marks and the lowest numbers
_TAGS_HINT = (
    "Cut along the grey marks, the white stays on the tag; the number stands below its tag. Cut and"
    " glue one at a time."
)
_BOARD_HINT = (
    "Glue it flat on a stiff plate; measure several squares in a row with a caliper, divide, and"
    " store the length of one: defsense capture board --measured MM"
)


def outer(tags: Dictionary, size: float) -> float:
    """The side, mm, of what is cut out: a tag of `size` mm with one white cell around."""
    return size * (tags.cells + 4) / (tags.cells + 2)


@contextmanager
def pdf(path: Path, title: str) -> Iterator[Any]:
    """A reportlab canvas in mm, saved in place at the end, that viewers print at 100 % unless told
    otherwise. Raises StorageError where it cannot be written."""
    from reportlab.pdfgen.canvas import Canvas

    with replace_file(path) as temporary:
        canvas = Canvas(str(temporary), invariant=1)
        canvas.setTitle(title)
        canvas.setAuthor("defsense-fab")
        canvas.setViewerPreference("PrintScaling", "None")
        yield canvas
        canvas.save()


def paper_size(name: str) -> tuple[float, float]:
    """Width and height, mm, upright. Raises CaptureError for a paper that is not known."""
    if name.lower() not in PAPERS:
        raise CaptureError(
            f"paper {name}: not known; there are {', '.join(PAPERS)}",
            code="unknown-paper",
            papers=tuple(PAPERS),
        )
    return PAPERS[name.lower()]


def draw_tags(
    canvas: Any, tags: Dictionary, numbers: Sequence[int], size: float, paper: str, title: str
) -> None:
    """As many pages as the tags of `numbers` with black squares of `size` mm need. Raises
    CaptureError for tags larger than the paper or numbers that the family has not."""
    width, height = paper_size(paper)
    side = outer(tags, size)
    room = np.array([width - _LEFT - _RIGHT, height - _BOTTOM - _TOP - _NUMBER])
    across, down = (int((r + g) // (side + g)) for r, g in zip(room, _GAP, strict=True))
    if across < 1 or down < 1 or size <= 0:
        raise CaptureError(
            f"tags of {size:g} mm with their white do not fit on {paper}", code="print-too-large"
        )
    pages = [numbers[i : i + across * down] for i in range(0, len(numbers), across * down)]
    for n, page in enumerate(pages):
        _start(canvas, width, height)
        count = f", sheet {n + 1} of {len(pages)}" if len(pages) > 1 else ""
        _frame(canvas, width, height, f"{title}: tags of {size:g} mm, {tags.name}{count}")
        _text(canvas, _LEFT, height - 26, _TAGS_HINT, 8.5)
        for k, number in enumerate(page):
            x = _LEFT + k % across * (side + _GAP[0])
            y = height - _TOP - _MARK - side - k // across * (side + _GAP[1])
            _tag(canvas, tags, number, (x, y), size)
        canvas.showPage()


def write_board(board: CharucoBoard, path: Path, paper: str = "a4") -> None:
    """The board as drawn, at its nominal size, on paper turned as it fits. Raises CaptureError
    where it does not fit and StorageError where it cannot be written."""
    width, height = _turned(board, paper)
    across, down = board.columns * board.square, board.rows * board.square
    title = (
        f"ChArUco board, {board.columns} x {board.rows} squares of {board.square:g} mm, tags of"
        f" {board.marker:g} mm, {board.family.name}"
    )
    with pdf(path, title) as canvas:
        _start(canvas, width, height)
        _frame(canvas, width, height, title)
        _text(canvas, _LEFT, height - 26, _BOARD_HINT, 8.5)
        left = max(_LEFT, (width - across) / 2)
        low = _BOTTOM + (height - _BOTTOM - _TOP - down) / 2
        black = np.indices((board.rows, board.columns)).sum(0) % 2 == 0
        _cells(canvas, black, (left, low), board.square)
        drawn = CharucoBoard(
            board.columns, board.rows, board.square, board.marker, board.dictionary
        )
        charuco = drawn.charuco
        for number, corners in zip(charuco.getIds(), charuco.getObjPoints(), strict=True):
            x, y = np.min(corners, axis=0)[0], np.max(corners, axis=0)[1]
            pattern = board.family.pattern(int(number)) == 0
            cell = board.marker / len(pattern)
            _cells(canvas, pattern, (left + float(x), low + down - float(y)), cell)
        canvas.showPage()


def _turned(board: CharucoBoard, paper: str) -> tuple[float, float]:
    """The paper's width and height, turned so that the board fits."""
    upright = paper_size(paper)
    wide = board.columns >= board.rows
    best = 0.0
    for width, height in (upright[::-1], upright) if wide else (upright, upright[::-1]):
        side = min((width - _LEFT - _RIGHT) / board.columns, (height - _BOTTOM - _TOP) / board.rows)
        if side >= board.square - 1e-9:
            return width, height
        best = max(best, side)
    raise CaptureError(
        f"board: {board.columns} x {board.rows} squares of {board.square:g} mm do not fit on"
        f" {paper} with its margins and rulers; squares of {np.floor(2 * best) / 2:g} mm would,"
        " or take larger paper or fewer squares",
        code="print-too-large",
        square=float(np.floor(2 * best) / 2),
    )


def _start(canvas: Any, width: float, height: float) -> None:
    canvas.setPageSize((width * _MM, height * _MM))
    canvas.scale(_MM, _MM)


def _frame(canvas: Any, width: float, height: float, title: str) -> None:
    """Title, corner crosses at known distances, and two rulers."""
    across, down = (10 * ((n - 2 * _EDGE) // 10) for n in (width, height))
    left, low = (width - across) / 2, (height - down) / 2
    canvas.setStrokeGray(0)
    canvas.setLineWidth(0.2)
    for x in (left, left + across):
        for y in (low, low + down):
            canvas.line(x - 2.5, y, x + 2.5, y)
            canvas.line(x, y - 2.5, x, y + 2.5)
    _text(canvas, _LEFT, height - 17, title, 11, bold=True)
    check = (
        "Print at 100 %, without 'fit to page'. Both rulers must be"
        f" {RULER:g} mm, the corner crosses {across:g} mm apart across and {down:g} mm down."
    )
    _text(canvas, _LEFT, height - 21.5, check, 8.5)
    _ruler(canvas, (_LEFT, 17.0), upright=False)
    _ruler(canvas, (19.0, _BOTTOM), upright=True)
    _text(canvas, _LEFT + RULER + 4, 17.5, "this line must be 100 mm", 8.5)


def _ruler(canvas: Any, at: tuple[float, float], upright: bool) -> None:
    """A line of 100 mm between the middles of its outer ticks, which stand on it."""
    canvas.saveState()
    canvas.translate(*at)
    if upright:
        canvas.rotate(90)
    canvas.setStrokeGray(0)
    canvas.setLineWidth(0.2)
    canvas.line(0, 0, RULER, 0)
    for k in range(int(RULER) + 1):
        canvas.line(k, 0, k, 5 if k % 10 == 0 else 3.5 if k % 5 == 0 else 2)
        if k % 10 == 0:
            canvas.setFont("Helvetica", 6 / _MM)
            canvas.drawCentredString(k, 5.7, str(k))
    canvas.restoreState()


def _tag(canvas: Any, tags: Dictionary, number: int, at: tuple[float, float], size: float) -> None:
    """A tag whose piece has its lower left corner `at`."""
    pattern = tags.pattern(number) == 0
    cell = size / len(pattern)
    (x, y), side = at, size + 2 * cell
    _cells(canvas, pattern, (x + cell, y + cell), cell)
    canvas.setStrokeGray(_GREY)
    canvas.setLineWidth(0.12)
    for cx, dx in ((x, -1), (x + side, 1)):
        for cy, dy in ((y, -1), (y + side, 1)):
            canvas.line(cx + 0.5 * dx, cy, cx + _MARK * dx, cy)
            canvas.line(cx, cy + 0.5 * dy, cx, cy + _MARK * dy)
    canvas.setFillGray(0)
    canvas.setFont("Helvetica-Bold", 9 / _MM)
    canvas.drawCentredString(x + side / 2, y - 3.8, str(number))


def _cells(canvas: Any, black: Bool, at: tuple[float, float], cell: float) -> None:
    """Black cells as one filled region, the picture's lower left corner `at`."""
    path = canvas.beginPath()
    top = at[1] + len(black) * cell
    for polygon in outlines(black):
        for k, (column, row) in enumerate(polygon):
            (path.lineTo if k else path.moveTo)(at[0] + column * cell, top - row * cell)
        path.close()
    canvas.setFillGray(0)
    canvas.drawPath(path, stroke=0, fill=1, fillMode=0)


def _text(canvas: Any, x: float, y: float, text: str, points: float, bold: bool = False) -> None:
    canvas.setFillGray(0)
    canvas.setFont("Helvetica-Bold" if bold else "Helvetica", points / _MM)
    canvas.drawString(x, y, text)
