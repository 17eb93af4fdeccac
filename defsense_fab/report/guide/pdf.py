"""The assembly guide as PDF, for the bench: pages that fit A4 and Letter at 100 %."""

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
from .guide import AssemblyStep, Guide, ShownPassage
from .tables import GuideTable
from .template_pages import CordStrip, CutFace, Ruler

#: What A4 (210 x 297 mm) and Letter (215.9 x 279.4 mm) have in common, mm, and what printers leave
#: white of it.
PAGE, MARGIN = (210.0, 279.4), 14.0
_WIDTH = (PAGE[0] - 2 * MARGIN) * mm
_HEIGHT = (PAGE[1] - 2 * MARGIN - 12) * mm
_SHOWN = (0.40, 0.60)  # shares of the width of a passage's sentences and of its picture
_TALL = 60 * mm  # the most of a step's picture


def write_pdf(guide: Guide, path: Path) -> None:
    """Write the guide, whole or not at all. Raises StorageError."""
    with replace_file(path) as temporary:
        _document(guide, temporary)


def _document(guide: Guide, path: Path) -> None:
    style = getSampleStyleSheet()
    for name in ("Normal", "BodyText"):
        style[name].fontSize, style[name].leading = 9.5, 11.5
    style["Heading2"].keepWithNext = 1
    margin = MARGIN * mm
    document = SimpleDocTemplate(
        str(path), pagesize=(PAGE[0] * mm, PAGE[1] * mm), title=guide.title, author="defsense-fab",
        invariant=1, leftMargin=margin, rightMargin=margin, topMargin=margin, bottomMargin=margin,
    )  # fmt: skip
    flow: list[Any] = [
        Paragraph(escape(guide.title), style["Title"]),
        Paragraph(escape(guide.intro), style["Normal"]),
        *(Paragraph("Note: " + escape(w), style["Normal"]) for w in guide.warnings),
        Spacer(0, 4 * mm),
        _image(guide.exploded, _WIDTH, 100 * mm),
    ]
    for table in guide.tables:
        flow += _table(table, style)
    for number, step in enumerate(guide.steps, 1):
        flow += _step(number, step, style)
    flow += _table(guide.checks, style)
    flow += _templates(guide, style)
    document.build(flow, onFirstPage=_number, onLaterPages=_number)


def _number(canvas: Any, _: Any) -> None:
    canvas.setFont("Helvetica", 9)
    canvas.drawRightString((PAGE[0] - MARGIN) * mm, 8 * mm, str(canvas.getPageNumber()))


def _image(uri: str, width: float, height: float) -> Any:
    """As large as it fits into so much room, points."""
    data = base64.b64decode(uri.partition(",")[2])
    image = Image(io.BytesIO(data))
    scale = min(width / image.drawWidth, height / image.drawHeight)
    image.drawWidth *= scale
    image.drawHeight *= scale
    return image


def _step(number: int, step: AssemblyStep, style: Any) -> list[Any]:
    """Its passages stay together where a page holds them."""
    head = Paragraph(f"{number}. {escape(step.title)}", style["Heading2"])
    passages = [_passage(p, style) for p in step.passages]
    tall = sum(p.wrap(_WIDTH, _HEIGHT)[1] for p in passages)
    if tall < _HEIGHT - 15 * mm:
        return [KeepTogether([head, *passages])]
    return [KeepTogether([head, passages[0]]), *passages[1:]]


def _passage(passage: ShownPassage, style: Any) -> Any:
    """Sentences, and beside them their picture."""
    lines = [Paragraph(escape(x), style["Normal"], bulletText="-") for x in passage.lines]
    rows: list[list[Any]] = [[line] for line in lines]
    widths, spans = [_WIDTH], list[Any]()
    if passage.picture:
        widths = [share * _WIDTH for share in _SHOWN]
        beside = _beside(lines, widths[0])
        picture = _image(passage.picture, widths[1] - 4 * mm, _TALL)
        rows = [[lines[:beside], picture], *([line, ""] for line in lines[beside:])]
        spans = [("SPAN", (0, k), (1, k)) for k in range(1, len(rows))]
    made = Table(rows, colWidths=widths, splitInRow=1)
    made.setStyle([
        ("VALIGN", (0, 0), (-1, -1), "TOP"), ("LEFTPADDING", (0, 0), (-1, -1), 0),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 1), ("TOPPADDING", (0, 0), (-1, -1), 1), *spans,
    ])  # fmt: skip
    return made


def _beside(lines: list[Any], width: float) -> int:
    """How many sentences stand beside the picture: all where that takes up to half a page, else as
    many as are no taller than it, and the others below."""
    tall = np.cumsum([line.wrap(width, _HEIGHT)[1] for line in lines])
    if tall[-1] <= _HEIGHT / 2:
        return len(lines)
    return max(int((tall <= _TALL).sum()), 1)


def _templates(guide: Guide, style: Any) -> list[Any]:
    """The last pages: cords and faces at 1:1."""
    if not guide.strips:
        return []
    room = _WIDTH / mm, _HEIGHT / mm - 20
    flow: list[Any] = [
        PageBreak(),
        Paragraph("Templates at 1:1", style["Heading1"]),
        Paragraph(
            "Print these pages at 100 %, without 'fit to page', on A4 or Letter. The ruler must"
            " measure 100 mm; if it does not, the printer scaled the page.",
            style["Normal"],
        ),
        Spacer(0, 2 * mm),
        Ruler(),
    ]
    flow += [KeepTogether([CordStrip(s, _WIDTH / mm)]) for s in guide.strips]
    for face in guide.faces:
        found = CutFace.turned(face, *room)
        title = Paragraph(f"{escape(face.title)}, at 1:1", style["Heading3"])
        if found is None:
            size = " x ".join(f"{n:.0f}" for n in face.size)
            text = f"It measures {size} mm, more than a page holds."
            flow.append(KeepTogether([title, Paragraph(text, style["Normal"])]))
        else:
            flow.append(KeepTogether([title, found]))
    return flow


def _long(text: str) -> float:
    """Width of a text in a table's cell, points."""
    return float(stringWidth(text, "Helvetica-Bold", 8.5)) + 13


def _table(table: GuideTable, style: Any) -> list[Any]:
    small = style["BodyText"].clone("small", fontSize=8.5, leading=10.5)
    rows = [[Paragraph(f"<b>{escape(h)}</b>", small) for h in table.header]]
    rows += [[Paragraph(escape(cell), small) for cell in row] for row in table.rows]
    columns = list(zip(table.header, *table.rows, strict=True))
    # No word is broken; what is left goes to the columns with long sentences.
    least = [max(_long(word) for cell in c for word in cell.split() or [""]) for c in columns]
    whole = [
        max(max(_long(cell) for cell in c) - n, 0.1) for c, n in zip(columns, least, strict=True)
    ]
    share = min(1.0, (_WIDTH - sum(least)) / sum(whole))
    widths = [n + max(share, 0.0) * w for n, w in zip(least, whole, strict=True)]
    made = Table(rows, colWidths=widths, repeatRows=1, hAlign="LEFT")
    made.setStyle(
        [
            ("LINEBELOW", (0, 0), (-1, -1), 0.4, colors.lightgrey),
            ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ]
    )
    return [Paragraph(escape(table.title), style["Heading2"]), made]
