"""The templates on paper: a ruler to check the scale, cords as strips, the faces they lie in."""

from __future__ import annotations

from typing import Any

import numpy as np
from reportlab.lib import colors
from reportlab.lib.units import mm
from reportlab.platypus import Flowable

from ...core.arrays import Float
from .templates import Face, Strip

RULER = 100.0  # mm
_ROW, _SIDE = 24.0, 5.0  # mm: a row of a strip, and what is left free at its sides
_INK, _HINT, _GROOVE = colors.black, colors.HexColor("#52616b"), colors.HexColor("#c3ccd2")
_TRIM, _BRASS = colors.HexColor("#d9d9d9"), colors.HexColor("#f3e3a3")
_SMALL, _TINY = 8, 7


class Ruler(Flowable):  # type: ignore[misc]
    """100 mm to hold a ruler to."""

    def wrap(self, *_: Any) -> tuple[float, float]:
        return (RULER + 2 * _SIDE) * mm, 14 * mm

    def draw(self) -> None:
        c = self.canv
        c.setStrokeColor(_INK)
        c.setLineWidth(0.6)
        c.line(_SIDE * mm, 6 * mm, (_SIDE + RULER) * mm, 6 * mm)
        for k in range(int(RULER) + 1):
            long = 4 if k % 10 == 0 else 2.5 if k % 5 == 0 else 1.5
            c.setLineWidth(0.6 if k % 10 == 0 else 0.3)
            c.line((_SIDE + k) * mm, 6 * mm, (_SIDE + k) * mm, (6 + long) * mm)
            if k % 10 == 0:
                c.setFont("Helvetica", _TINY)
                c.drawCentredString((_SIDE + k) * mm, 2.5 * mm, str(k))


class CordStrip(Flowable):  # type: ignore[misc]
    """A cord at 1:1, in as many rows as it needs on a page `width` mm wide."""

    def __init__(self, strip: Strip, width: float) -> None:
        super().__init__()
        self._strip, self._width = strip, width
        half = strip.ferrule[1] / 2
        per = width - 2 * _SIDE
        self._starts = [-half]
        while self._starts[-1] + per < strip.length:
            self._starts.append(self._starts[-1] + per)
        self._per = per
        self._head = 5 + 3.5 * len(strip.notes)

    def wrap(self, *_: Any) -> tuple[float, float]:
        return self._width * mm, (_ROW * len(self._starts) + self._head) * mm

    def draw(self) -> None:
        c, s = self.canv, self._strip
        top = _ROW * len(self._starts) + self._head
        c.setFillColor(_INK)
        c.setFont("Helvetica-Bold", _SMALL + 2)
        c.drawString(0, (top - 4) * mm, s.title)
        c.setFont("Helvetica", _SMALL)
        for k, note in enumerate(s.notes):
            c.drawString(0, (top - 8 - 3.5 * k) * mm, note)
        for row, start in enumerate(self._starts):
            self._row(row, start, top - self._head - _ROW * row - 10)

    def _row(self, row: int, start: float, y: float) -> None:
        """Of what lies from `start` on; the cord's middle is at y mm."""
        c, s = self.canv, self._strip
        stop = start + self._per

        def x(at: float) -> float:
            return float((_SIDE + at - start) * mm)

        low, high = max(0.0, start), min(s.length, stop)
        for a, b, fill in ((low, min(high, s.mark), _INK), (max(low, s.mark), high, _TRIM)):
            if a < b:
                c.setFillColor(fill)
                c.setLineWidth(0.2)
                c.rect(x(a), (y - s.cord / 2) * mm, (b - a) * mm, s.cord * mm, fill=1)
        for middle, end in ((0.0, s.first), (s.mark, s.second)):
            self._ferrule(x, y, start, stop, middle, end)
        self._tick(x, y, start, stop, s.length, f"cut, {s.length:.1f}")
        if s.length - s.mark > 0:
            self._tick(x, y, start, stop, s.mark, f"mark, trim here, {s.mark:.1f}")
        self._tick(x, y, start, stop, 0.0, "cut, 0")
        c.setFillColor(_HINT)
        c.setFont("Helvetica", _TINY)
        if row:
            c.drawString(0, (y + 5) * mm, f"{chr(64 + row)}: goes on from above at {start:.1f} mm")
            self._break(x(start), y)
        if stop < s.length:
            text = f"{chr(65 + row)}: goes on below at {stop:.1f} mm"
            c.drawRightString(self._width * mm, (y + 5) * mm, text)
            self._break(x(stop), y)

    def _ferrule(
        self, x: Any, y: float, start: float, stop: float, middle: float, end: str
    ) -> None:
        c, (wide, long) = self.canv, self._strip.ferrule
        a, b = max(start, middle - long / 2), min(stop, middle + long / 2)
        if a >= b:
            return
        c.setStrokeColor(_INK)
        c.setLineWidth(0.5)
        c.setFillColor(_BRASS)
        c.rect(x(a), (y - wide / 2) * mm, (b - a) * mm, wide * mm, fill=1)
        c.setFillColor(_INK)
        c.setFont("Helvetica", _TINY)
        if start <= middle <= stop:
            c.drawCentredString(min(max(x(middle), 9 * mm), (self._width - 9) * mm),
                                (y + 2.2) * mm, f"ferrule, {end}")  # fmt: skip

    def _tick(self, x: Any, y: float, start: float, stop: float, at: float, text: str) -> None:
        if not start - 1e-6 <= at <= stop + 1e-6:
            return
        c = self.canv
        c.setStrokeColor(_INK)
        c.setLineWidth(0.4)
        c.line(x(at), (y - 5) * mm, x(at), (y + 1.8) * mm)
        c.setFillColor(_INK)
        c.setFont("Helvetica", _TINY)
        wide = c.stringWidth(text, "Helvetica", _TINY)
        left = min(max(x(at) - wide / 2, 0), self._width * mm - wide)
        drop = 10.5 if text.startswith("mark") else 7.8
        c.drawString(left, (y - drop) * mm, text)

    def _break(self, x: float, y: float) -> None:
        """A zigzag where a strip is broken."""
        c = self.canv
        c.setStrokeColor(_INK)
        c.setLineWidth(0.6)
        for k in range(4):
            c.line(x + (k % 2 * 1.4 - 0.7) * mm, (y - 4 + 2 * k) * mm,
                   x + ((k + 1) % 2 * 1.4 - 0.7) * mm, (y - 2 + 2 * k) * mm)  # fmt: skip


class CutFace(Flowable):  # type: ignore[misc]
    """A joint's face at 1:1."""

    def __init__(self, face: Face) -> None:
        super().__init__()
        self._face = face
        self._size = face.size + 2 * _SIDE

    @staticmethod
    def turned(face: Face, width: float, height: float) -> CutFace | None:
        """Upright or across, as it fits a page of this room, mm; None where it does not."""
        for some in (face, _turned(face)):
            if (some.size + 2 * _SIDE <= (width, height)).all():
                return CutFace(some)
        return None

    def wrap(self, *_: Any) -> tuple[float, float]:
        return self._size[0] * mm, self._size[1] * mm

    def draw(self) -> None:
        c, f = self.canv, self._face
        c.translate(_SIDE * mm, _SIDE * mm)
        for line, wide, color in (
            *((w, 0.7, colors.HexColor("#c1121f")) for w in f.wires),
            *((x.line, f.cord, _GROOVE) for x in f.cords),
        ):
            self._line(line, wide, color)
        for lying in f.cords:
            for middle, along in lying.ferrules:
                self._ferrule(middle, along)
            self._line(lying.line, 0.15, _INK)
        c.setStrokeColor(_INK)
        c.setLineWidth(0.35)
        for (ax, ay), (bx, by) in f.outline.tolist():
            c.line(ax * mm, ay * mm, bx * mm, by * mm)
        c.setFont("Helvetica", _TINY)
        for letter, (px, py), diameter in f.pins:
            c.setFillColor(_INK)
            c.drawCentredString(px * mm, py * mm - _TINY / 3, f"{letter} {diameter:g}")
        for lying in f.cords:
            x, y = lying.line[len(lying.line) // 2]
            inwards = f.cord / 2 + 1.2 if y < f.size[1] / 2 else -f.cord / 2 - 3.2
            c.setFillColor(_INK)
            c.drawCentredString(x * mm, (y + inwards) * mm, lying.name)

    def _line(self, line: Float, wide: float, color: Any) -> None:
        c = self.canv
        c.setStrokeColor(color)
        c.setLineWidth(wide * mm)
        path = c.beginPath()
        path.moveTo(*(line[0] * mm))
        for point in line[1:]:
            path.lineTo(*(point * mm))
        c.drawPath(path)

    def _ferrule(self, middle: Float, along: Float) -> None:
        c, (wide, long) = self.canv, self._face.ferrule
        c.saveState()
        c.translate(*(middle * mm))
        c.rotate(float(np.degrees(np.arctan2(along[1], along[0]))))
        c.setFillColor(_BRASS)
        c.setStrokeColor(_INK)
        c.setLineWidth(0.4)
        c.rect(-long / 2 * mm, -wide / 2 * mm, long * mm, wide * mm, fill=1)
        c.restoreState()


def _turned(face: Face) -> Face:
    """By a quarter."""
    from dataclasses import replace

    from .templates import Lying

    high = face.size[1]

    def q(p: Float) -> Float:
        return np.stack([high - p[..., 1], p[..., 0]], axis=-1)

    def d(p: Float) -> Float:
        return np.array([-p[1], p[0]])

    return replace(
        face,
        outline=q(face.outline),
        cords=tuple(
            Lying(x.name, q(x.line), tuple((q(m), d(a)) for m, a in x.ferrules)) for x in face.cords
        ),
        wires=tuple(q(w) for w in face.wires),
        pins=tuple((letter, q(m), wide) for letter, m, wide in face.pins),
        size=face.size[::-1],
    )
