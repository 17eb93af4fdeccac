"""The assembly guide as PDF, for the bench."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

from reportlab.lib import colors
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import getSampleStyleSheet
from reportlab.lib.units import mm
from reportlab.platypus import Image, KeepTogether, Paragraph, SimpleDocTemplate, Spacer, Table

from ...core.files import replacing
from .guide import AssemblyStep, Guide
from .guide_tables import GuideTable

_MARGIN = 18 * mm
_WIDTH = A4[0] - 2 * _MARGIN


def write_pdf(guide: Guide, path: Path) -> None:
    """Write the guide on A4 pages, whole or not at all. Raises StorageError."""
    with replacing(path) as temporary:
        _document(guide, temporary)


def _document(guide: Guide, path: Path) -> None:
    style = getSampleStyleSheet()
    document = SimpleDocTemplate(
        str(path), pagesize=A4, title=guide.title, author="defsense-fab", invariant=1,
        leftMargin=_MARGIN, rightMargin=_MARGIN, topMargin=_MARGIN, bottomMargin=_MARGIN,
    )  # fmt: skip
    flow: list[Any] = [
        Paragraph(escape(guide.title), style["Title"]),
        Paragraph(escape(guide.intro), style["Normal"]),
        *(Paragraph("Note: " + escape(w), style["Normal"]) for w in guide.warnings),
        Spacer(0, 4 * mm),
        _image(guide.exploded),
    ]
    for table in guide.tables:
        flow += _table(table, style)
    for number, step in enumerate(guide.steps, 1):
        flow.append(_step(number, step, style))
    flow += _table(guide.checks, style)
    document.build(flow, onFirstPage=_number, onLaterPages=_number)


def _number(canvas: Any, _: Any) -> None:
    canvas.setFont("Helvetica", 9)
    canvas.drawRightString(A4[0] - _MARGIN, 10 * mm, str(canvas.getPageNumber()))


def _image(uri: str) -> Any:
    data = base64.b64decode(uri.partition(",")[2])
    image = Image(io.BytesIO(data))
    image.drawHeight *= _WIDTH / image.drawWidth
    image.drawWidth = _WIDTH
    return image


def _step(number: int, step: AssemblyStep, style: Any) -> Any:
    flow: list[Any] = [Paragraph(f"{number}. {escape(step.title)}", style["Heading2"])]
    flow += [Paragraph(escape(x), style["Normal"], bulletText="-") for x in step.lines]
    if step.picture:
        flow += [Spacer(0, 2 * mm), _image(step.picture)]
    return KeepTogether(flow)


def _table(table: GuideTable, style: Any) -> list[Any]:
    small = style["BodyText"].clone("small", fontSize=8.5, leading=10.5)
    rows = [[Paragraph(f"<b>{escape(h)}</b>", small) for h in table.header]]
    rows += [[Paragraph(escape(cell), small) for cell in row] for row in table.rows]
    longest = [
        max(len(c) for c in column) ** 0.7 for column in zip(table.header, *table.rows, strict=True)
    ]
    widths = [_WIDTH * n / sum(longest) for n in longest]
    made = Table(rows, colWidths=widths, repeatRows=1)
    made.setStyle(
        [
            ("LINEBELOW", (0, 0), (-1, -1), 0.4, colors.lightgrey),
            ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ]
    )
    return [Paragraph(escape(table.title), style["Heading2"]), made]
