"""Write the templates as PDF: a ruler to check the scale, cords, and faces at 1:1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from reportlab.lib import colors
from reportlab.lib.styles import getSampleStyleSheet
from reportlab.lib.units import mm
from reportlab.platypus import (
    BaseDocTemplate,
    Flowable,
    Frame,
    KeepTogether,
    NextPageTemplate,
    PageBreak,
    PageTemplate,
    Paragraph,
    Spacer,
)

from ...core.arrays import Float
from ...core.storage.files import replace_file
from .templates import CordTemplate, FaceTemplate

#: Width and height that both A4 (210 x 297 mm) and Letter (215.9 x 279.4 mm) hold.
PAGE_SIZE_MM = (210.0, 279.4)
PAGE_MARGIN_MM = 14.0  # printers do not print closer to the edge
_TITLE_HEIGHT_MM = 32.0
_PORTRAIT = "portrait"
_PAGES = {_PORTRAIT: PAGE_SIZE_MM, "landscape": PAGE_SIZE_MM[::-1]}
RULER_LENGTH_MM = 100.0
_ROW_HEIGHT_MM, _SIDE_MARGIN_MM = 24.0, 5.0
_SAME_PLACE_MM = 1e-6
_INK, _HINT_COLOR = colors.black, colors.HexColor("#52616b")
_GROOVE_COLOR, _WIRE_COLOR = colors.HexColor("#c3ccd2"), colors.HexColor("#7b2cbf")
_EXCESS_COLOR, _FERRULE_COLOR = colors.HexColor("#d9d9d9"), colors.HexColor("#f3e3a3")
_SMALL_FONT_PT, _TINY_FONT_PT = 8, 7


def write_templates(
    path: Path, title: str, strips: Sequence[CordTemplate], faces: Sequence[FaceTemplate]
) -> None:
    """Write templates as PDF, completely or not at all.

    The pages fit A4 and Letter at 100 %; the same templates give the same bytes.

    Args:
        path: The file to write, usually `templates.pdf`.
        title: Title of the document.
        strips: Templates of cords.
        faces: Templates of the joints' faces.

    Raises:
        StorageError: The file cannot be written.
    """
    style = getSampleStyleSheet()
    flow: list[Any] = [
        Paragraph(escape(title), style["Heading1"]),
        Paragraph(
            "Print these pages at 100 %, without 'fit to page', on A4 or Letter. Check that the"
            " ruler measures 100 mm. If it does not, the printer scaled the page.",
            style["Normal"],
        ),
        Spacer(0, 2 * mm),
        Ruler(),
        *(KeepTogether([CordStrip(strip, drawing_size(_PORTRAIT)[0])]) for strip in strips),
    ]
    current = _PORTRAIT
    for face in faces:
        page = page_of(face)
        drawing: Any = CutFace(face)
        if page is None:
            size = " x ".join(f"{n:.0f}" for n in face.size)
            text = f"This face measures {size} mm, which is larger than a page."
            drawing = Paragraph(text, style["Normal"])
        elif page != current:
            flow += [NextPageTemplate(page), PageBreak()]
            current = page
        heading = Paragraph(f"{escape(face.title)}, at 1:1", style["Heading3"])
        flow.append(KeepTogether([heading, drawing]))
    with replace_file(path) as temporary:
        document = BaseDocTemplate(str(temporary), title=title, author="defsense-fab", invariant=1)
        document.addPageTemplates([_page_template(page) for page in _PAGES])
        document.build(flow)


def drawing_size(page: str) -> tuple[float, float]:
    """Return the width and height for a drawing below its title on a page, mm."""
    width, height = _PAGES[page]
    return width - 2 * PAGE_MARGIN_MM, height - 2 * PAGE_MARGIN_MM - _TITLE_HEIGHT_MM


def page_of(face: FaceTemplate) -> str | None:
    """Return "portrait" or "landscape", the page that a face fits; None if it fits neither."""
    size = face.size + 2 * _SIDE_MARGIN_MM
    return next((page for page in _PAGES if (size <= drawing_size(page)).all()), None)


def _page_template(page: str) -> PageTemplate:
    width, height = (n * mm for n in _PAGES[page])
    margin = PAGE_MARGIN_MM * mm
    frame = Frame(margin, margin, width - 2 * margin, height - 2 * margin)

    def write_number(canvas: Any, _: Any) -> None:
        canvas.setFont("Helvetica", 9)
        canvas.drawRightString(width - margin, 8 * mm, str(canvas.getPageNumber()))

    return PageTemplate(page, frame, onPage=write_number, pagesize=(width, height))


class Ruler(Flowable):  # type: ignore[misc]
    """A ruler of 100 mm to check the scale of the print with."""

    def wrap(self, *_: Any) -> tuple[float, float]:
        """Return width and height, points."""
        return (RULER_LENGTH_MM + 2 * _SIDE_MARGIN_MM) * mm, 14 * mm

    def draw(self) -> None:
        """Draw the ruler on the current canvas."""
        c = self.canv
        c.setStrokeColor(_INK)
        c.setLineWidth(0.6)
        c.line(_SIDE_MARGIN_MM * mm, 6 * mm, (_SIDE_MARGIN_MM + RULER_LENGTH_MM) * mm, 6 * mm)
        for k in range(int(RULER_LENGTH_MM) + 1):
            length = 4 if k % 10 == 0 else 2.5 if k % 5 == 0 else 1.5
            x = (_SIDE_MARGIN_MM + k) * mm
            c.setLineWidth(0.6 if k % 10 == 0 else 0.3)
            c.line(x, 6 * mm, x, (6 + length) * mm)
            if k % 10 == 0:
                c.setFont("Helvetica", _TINY_FONT_PT)
                c.drawCentredString(x, 2.5 * mm, str(k))


class CordStrip(Flowable):  # type: ignore[misc]
    """A cord at 1:1, in as many rows as it needs.

    Args:
        template: The cord.
        width: Width of the page's frame, mm.

    Attributes:
        row_starts: Place on the cord at which each row starts, mm.
    """

    def __init__(self, template: CordTemplate, width: float) -> None:
        super().__init__()
        self._template, self._width = template, width
        self._row_length = width - 2 * _SIDE_MARGIN_MM
        self.row_starts = [-template.ferrule[1] / 2]
        while self.row_starts[-1] + self._row_length < template.length:
            self.row_starts.append(self.row_starts[-1] + self._row_length)
        self._head_height = 5 + 3.5 * len(template.notes)

    def wrap(self, *_: Any) -> tuple[float, float]:
        """Return width and height, points."""
        height = _ROW_HEIGHT_MM * len(self.row_starts) + self._head_height
        return self._width * mm, height * mm

    def draw(self) -> None:
        """Draw the cord on the current canvas."""
        c, template = self.canv, self._template
        top = _ROW_HEIGHT_MM * len(self.row_starts) + self._head_height
        c.setFillColor(_INK)
        c.setFont("Helvetica-Bold", _SMALL_FONT_PT + 2)
        c.drawString(0, (top - 4) * mm, template.title)
        c.setFont("Helvetica", _SMALL_FONT_PT)
        for k, note in enumerate(template.notes):
            c.drawString(0, (top - 8 - 3.5 * k) * mm, note)
        for row, start in enumerate(self.row_starts):
            self._draw_row(row, start, top - self._head_height - _ROW_HEIGHT_MM * row - 10)

    def _draw_row(self, row: int, start: float, y: float) -> None:
        """Draw the row that starts at a place on the cord; the cord's middle is at y mm."""
        c, template = self.canv, self._template
        stop = start + self._row_length

        def to_x(place: float) -> float:
            return float((_SIDE_MARGIN_MM + place - start) * mm)

        low, high = max(0.0, start), min(template.length, stop)
        pieces = (
            (low, min(high, template.mark), _INK),
            (max(low, template.mark), high, _EXCESS_COLOR),
        )
        for left, right, fill in pieces:
            if left < right:
                c.setFillColor(fill)
                c.setLineWidth(0.2)
                bottom = (y - template.cord / 2) * mm
                c.rect(to_x(left), bottom, (right - left) * mm, template.cord * mm, fill=1)
        for middle, end in ((0.0, template.first), (template.mark, template.second)):
            self._draw_ferrule(to_x, y, start, middle, end)
        length, mark = template.length, template.mark
        self._draw_tick(to_x, y, start, length, f"cut, {length:.1f}", 7.8)
        if length - mark > 0:
            self._draw_tick(to_x, y, start, mark, f"mark, trim here, {mark:.1f}", 10.5)
        self._draw_tick(to_x, y, start, 0.0, "cut, 0", 7.8)
        c.setFillColor(_HINT_COLOR)
        c.setFont("Helvetica", _TINY_FONT_PT)
        if row:
            text = f"{chr(64 + row)}: continued from above at {start:.1f} mm"
            c.drawString(0, (y + 5) * mm, text)
            self._draw_break(to_x(start), y)
        if stop < length:
            text = f"{chr(65 + row)}: continues below at {stop:.1f} mm"
            c.drawRightString(self._width * mm, (y + 5) * mm, text)
            self._draw_break(to_x(stop), y)

    def _draw_ferrule(
        self, to_x: Callable[[float], float], y: float, start: float, middle: float, end: str
    ) -> None:
        c, (diameter, length) = self.canv, self._template.ferrule
        stop = start + self._row_length
        left, right = max(start, middle - length / 2), min(stop, middle + length / 2)
        if left >= right:
            return
        c.setStrokeColor(_INK)
        c.setLineWidth(0.5)
        c.setFillColor(_FERRULE_COLOR)
        c.rect(to_x(left), (y - diameter / 2) * mm, (right - left) * mm, diameter * mm, fill=1)
        c.setFillColor(_INK)
        c.setFont("Helvetica", _TINY_FONT_PT)
        if start <= middle <= stop:
            x = min(max(to_x(middle), 9 * mm), (self._width - 9) * mm)
            c.drawCentredString(x, (y + 2.2) * mm, f"ferrule, {end}")

    def _draw_tick(
        self,
        to_x: Callable[[float], float],
        y: float,
        start: float,
        place: float,
        text: str,
        text_depth: float,
    ) -> None:
        """Draw a tick at a place on the cord, with a text some mm below the cord."""
        stop = start + self._row_length
        if not start - _SAME_PLACE_MM <= place <= stop + _SAME_PLACE_MM:
            return
        c, x = self.canv, to_x(place)
        c.setStrokeColor(_INK)
        c.setLineWidth(0.4)
        c.line(x, (y - 5) * mm, x, (y + 1.8) * mm)
        c.setFillColor(_INK)
        c.setFont("Helvetica", _TINY_FONT_PT)
        width = c.stringWidth(text, "Helvetica", _TINY_FONT_PT)
        left = min(max(x - width / 2, 0), self._width * mm - width)
        c.drawString(left, (y - text_depth) * mm, text)

    def _draw_break(self, x: float, y: float) -> None:
        """Draw a zigzag where the cord continues in another row."""
        c = self.canv
        c.setStrokeColor(_INK)
        c.setLineWidth(0.6)
        for k in range(4):
            x0, x1 = x + (k % 2 * 1.4 - 0.7) * mm, x + ((k + 1) % 2 * 1.4 - 0.7) * mm
            c.line(x0, (y - 4 + 2 * k) * mm, x1, (y - 2 + 2 * k) * mm)


class CutFace(Flowable):  # type: ignore[misc]
    """The face of a joint at 1:1.

    Args:
        template: The face.

    Attributes:
        size: Width and height (2,) with margins, mm.
    """

    def __init__(self, template: FaceTemplate) -> None:
        super().__init__()
        self._template = template
        self.size = template.size + 2 * _SIDE_MARGIN_MM

    def wrap(self, *_: Any) -> tuple[float, float]:
        """Return width and height, points."""
        return self.size[0] * mm, self.size[1] * mm

    def draw(self) -> None:
        """Draw the face on the current canvas."""
        c, template = self.canv, self._template
        c.translate(_SIDE_MARGIN_MM * mm, _SIDE_MARGIN_MM * mm)
        for line in template.wires:
            self._draw_line(line, 0.7, _WIRE_COLOR)
        for cord in template.cords:
            self._draw_line(cord.line, template.cord, _GROOVE_COLOR)
        for cord in template.cords:
            for middle, direction in cord.ferrules:
                self._draw_ferrule(middle, direction)
            self._draw_line(cord.line, 0.15, _INK)
        c.setStrokeColor(_INK)
        c.setLineWidth(0.35)
        for (x0, y0), (x1, y1) in template.outline.tolist():
            c.line(x0 * mm, y0 * mm, x1 * mm, y1 * mm)
        c.setFont("Helvetica", _TINY_FONT_PT)
        for letter, (x, y), diameter in template.pins:
            c.setFillColor(_INK)
            c.drawCentredString(x * mm, y * mm - _TINY_FONT_PT / 3, f"{letter} {diameter:g}")
        for cord in template.cords:
            x, y = cord.line[len(cord.line) // 2]
            is_low = y < template.size[1] / 2
            offset = template.cord / 2 + 1.2 if is_low else -template.cord / 2 - 3.2
            c.setFillColor(_INK)
            c.drawCentredString(x * mm, (y + offset) * mm, cord.name)

    def _draw_line(self, line: Float, width: float, color: Any) -> None:
        c = self.canv
        c.setStrokeColor(color)
        c.setLineWidth(width * mm)
        path = c.beginPath()
        path.moveTo(*(line[0] * mm))
        for point in line[1:]:
            path.lineTo(*(point * mm))
        c.drawPath(path)

    def _draw_ferrule(self, middle: Float, direction: Float) -> None:
        c, (diameter, length) = self.canv, self._template.ferrule
        c.saveState()
        c.translate(*(middle * mm))
        c.rotate(float(np.degrees(np.arctan2(direction[1], direction[0]))))
        c.setFillColor(_FERRULE_COLOR)
        c.setStrokeColor(_INK)
        c.setLineWidth(0.4)
        c.rect(-length / 2 * mm, -diameter / 2 * mm, length * mm, diameter * mm, fill=1)
        c.restoreState()
