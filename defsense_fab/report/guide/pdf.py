"""Write the assembly guide as PDF for the workbench, on pages that fit A4 and Letter at 100 %."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from reportlab.lib import colors
from reportlab.lib.styles import getSampleStyleSheet
from reportlab.lib.units import mm
from reportlab.pdfbase.pdfmetrics import stringWidth
from reportlab.platypus import (
    Image,
    KeepTogether,
    PageBreak,
    Paragraph,
    SimpleDocTemplate,
    Spacer,
    Table,
)

from ...core.storage.files import replace_file
from .guide import AssemblyStep, Guide, IllustratedPassage
from .tables import GuideTable
from .template_pages import CordStrip, CutFace, Ruler

#: Width and height that both A4 (210 x 297 mm) and Letter (215.9 x 279.4 mm) hold.
PAGE_SIZE_MM = (210.0, 279.4)
PAGE_MARGIN_MM = 14.0  # printers do not print closer to the edge
_WIDTH = (PAGE_SIZE_MM[0] - 2 * PAGE_MARGIN_MM) * mm
_HEIGHT = (PAGE_SIZE_MM[1] - 2 * PAGE_MARGIN_MM - 12) * mm
_TEXT_SHARE, _PICTURE_SHARE = 0.40, 0.60  # of the width of a passage
_MAX_PICTURE_HEIGHT = 60 * mm


def write_pdf(guide: Guide, path: Path) -> None:
    """Write the guide as PDF, completely or not at all.

    Args:
        guide: The guide.
        path: The file to write.

    Raises:
        StorageError: The file cannot be written.
    """
    with replace_file(path) as temporary:
        _build_document(guide, temporary)


def _build_document(guide: Guide, path: Path) -> None:
    style = getSampleStyleSheet()
    for name in ("Normal", "BodyText"):
        style[name].fontSize, style[name].leading = 9.5, 11.5
    style["Heading2"].keepWithNext = 1
    margin = PAGE_MARGIN_MM * mm
    document = SimpleDocTemplate(
        str(path),
        pagesize=(PAGE_SIZE_MM[0] * mm, PAGE_SIZE_MM[1] * mm),
        title=guide.title,
        author="defsense-fab",
        invariant=1,
        leftMargin=margin,
        rightMargin=margin,
        topMargin=margin,
        bottomMargin=margin,
    )
    flow: list[Any] = [
        Paragraph(escape(guide.title), style["Title"]),
        Paragraph(escape(guide.intro), style["Normal"]),
        *(Paragraph("Note: " + escape(w), style["Normal"]) for w in guide.warnings),
        Spacer(0, 4 * mm),
        _image(guide.exploded, _WIDTH, 100 * mm),
    ]
    for table in guide.tables:
        flow += _layout_table(table, style)
    for number, step in enumerate(guide.steps, 1):
        flow += _layout_step(number, step, style)
    flow += _layout_table(guide.checks, style)
    flow += _layout_templates(guide, style)
    document.build(flow, onFirstPage=_write_page_number, onLaterPages=_write_page_number)


def _write_page_number(canvas: Any, _: Any) -> None:
    canvas.setFont("Helvetica", 9)
    canvas.drawRightString(
        (PAGE_SIZE_MM[0] - PAGE_MARGIN_MM) * mm, 8 * mm, str(canvas.getPageNumber())
    )


def _image(uri: str, width: float, height: float) -> Any:
    """Return a picture as large as it fits into a width and height, points."""
    data = base64.b64decode(uri.partition(",")[2])
    image = Image(io.BytesIO(data))
    scale = min(width / image.drawWidth, height / image.drawHeight)
    image.drawWidth *= scale
    image.drawHeight *= scale
    return image


def _layout_step(number: int, step: AssemblyStep, style: Any) -> list[Any]:
    """Return a step; its passages stay together if a page holds them."""
    head = Paragraph(f"{number}. {escape(step.title)}", style["Heading2"])
    passages = [_layout_passage(p, style) for p in step.passages]
    height = sum(p.wrap(_WIDTH, _HEIGHT)[1] for p in passages)
    if height < _HEIGHT - 15 * mm:
        return [KeepTogether([head, *passages])]
    return [KeepTogether([head, passages[0]]), *passages[1:]]


def _layout_passage(passage: IllustratedPassage, style: Any) -> Any:
    """Return instructions with their picture beside them."""
    lines = [Paragraph(escape(x), style["Normal"], bulletText="-") for x in passage.lines]
    rows: list[list[Any]] = [[line] for line in lines]
    widths, spans = [_WIDTH], list[Any]()
    if passage.picture:
        widths = [_TEXT_SHARE * _WIDTH, _PICTURE_SHARE * _WIDTH]
        beside = _count_beside(lines, widths[0])
        picture = _image(passage.picture, widths[1] - 4 * mm, _MAX_PICTURE_HEIGHT)
        rows = [[lines[:beside], picture], *([line, ""] for line in lines[beside:])]
        spans = [("SPAN", (0, k), (1, k)) for k in range(1, len(rows))]
    table = Table(rows, colWidths=widths, splitInRow=1)
    table.setStyle([
        ("VALIGN", (0, 0), (-1, -1), "TOP"), ("LEFTPADDING", (0, 0), (-1, -1), 0),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 1), ("TOPPADDING", (0, 0), (-1, -1), 1), *spans,
    ])  # fmt: skip
    return table


def _count_beside(lines: list[Any], width: float) -> int:
    """Return how many instructions are placed beside the picture.

    All are, if they take up to half a page; else as many as are no taller than the picture, and the
    others are placed below.
    """
    heights = np.cumsum([line.wrap(width, _HEIGHT)[1] for line in lines])
    if heights[-1] <= _HEIGHT / 2:
        return len(lines)
    return max(int((heights <= _MAX_PICTURE_HEIGHT).sum()), 1)


def _layout_templates(guide: Guide, style: Any) -> list[Any]:
    """Return the last pages: cords and faces at 1:1."""
    if not guide.strips:
        return []
    frame = _WIDTH / mm, _HEIGHT / mm - 20
    flow: list[Any] = [
        PageBreak(),
        Paragraph("Templates at 1:1", style["Heading1"]),
        Paragraph(
            "Print these pages at 100 %, without 'fit to page', on A4 or Letter. Check that the"
            " ruler measures 100 mm. If it does not, the printer scaled the page.",
            style["Normal"],
        ),
        Spacer(0, 2 * mm),
        Ruler(),
    ]
    flow += [KeepTogether([CordStrip(s, _WIDTH / mm)]) for s in guide.strips]
    for face in guide.faces:
        cut_face = CutFace.fit(face, *frame)
        title = Paragraph(f"{escape(face.title)}, at 1:1", style["Heading3"])
        if cut_face is None:
            size = " x ".join(f"{n:.0f}" for n in face.size)
            text = f"This face measures {size} mm, which is larger than a page."
            flow.append(KeepTogether([title, Paragraph(text, style["Normal"])]))
        else:
            flow.append(KeepTogether([title, cut_face]))
    return flow


def _text_width(text: str) -> float:
    """Return the width of a text in a table's cell, points."""
    return float(stringWidth(text, "Helvetica-Bold", 8.5)) + 13


def _layout_table(table: GuideTable, style: Any) -> list[Any]:
    small = style["BodyText"].clone("small", fontSize=8.5, leading=10.5)
    rows = [[Paragraph(f"<b>{escape(h)}</b>", small) for h in table.header]]
    rows += [[Paragraph(escape(cell), small) for cell in row] for row in table.rows]
    columns = list(zip(table.header, *table.rows, strict=True))
    # No word is broken; the remaining width goes to the columns with long sentences.
    min_widths = [
        max(_text_width(word) for cell in c for word in cell.split() or [""]) for c in columns
    ]
    extra_widths = [
        max(max(_text_width(cell) for cell in c) - n, 0.1)
        for c, n in zip(columns, min_widths, strict=True)
    ]
    share = min(1.0, (_WIDTH - sum(min_widths)) / sum(extra_widths))
    widths = [n + max(share, 0.0) * w for n, w in zip(min_widths, extra_widths, strict=True)]
    flowable = Table(rows, colWidths=widths, repeatRows=1, hAlign="LEFT")
    flowable.setStyle(
        [
            ("LINEBELOW", (0, 0), (-1, -1), 0.4, colors.lightgrey),
            ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ]
    )
    return [Paragraph(escape(table.title), style["Heading2"]), flowable]
