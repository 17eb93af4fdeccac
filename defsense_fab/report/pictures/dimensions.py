"""Dimension lines around a straight view of a body."""

from __future__ import annotations

import numpy as np

from .sheet import SMALL, SOFT, Place, Sheet, extent

#: Pixels below a view and to the left of it that a line with its number takes.
BELOW, BESIDE = 44.0, 22.0
_AWAY, _TICK = 14.0, 6.0


def words(length: float) -> str:
    """A length in mm as it is written at its line."""
    return f"{length:.0f} mm" if length >= 99.5 else f"{length:.1f} mm"


def room(height: float) -> float:
    """Pixels to the left of a view for the line of its height, mm."""
    return BESIDE + extent(words(height), SMALL)[0] + 6


def across(sheet: Sheet, corner: Place, size: Place, length: float) -> None:
    """The width below a drawing of `size` pixels with its top left at `corner`."""
    (x, y), (w, h) = corner, size
    level = y + h + _AWAY
    for at, way in ((x, 1), (x + w, -1)):
        sheet.line([(at, y + h + 2), (at, level + _TICK)], SOFT, 1)
        _head(sheet, (at, level), (way, 0))
    sheet.line([(x, level), (x + w, level)], SOFT, 1)
    sheet.text((x + w / 2, level + 6 + SMALL / 2), words(length), SMALL)


def upright(sheet: Sheet, corner: Place, size: Place, length: float) -> None:
    """The height to the left of a drawing."""
    (x, y), (_, h) = corner, size
    level = x - _AWAY
    for at, way in ((y, 1), (y + h, -1)):
        sheet.line([(x - 2, at), (level - _TICK, at)], SOFT, 1)
        _head(sheet, (level, at), (0, way))
    sheet.line([(level, y), (level, y + h)], SOFT, 1)
    sheet.text((level - 9, y + h / 2), words(length), SMALL, anchor="rm")


def _head(sheet: Sheet, tip: Place, way: Place) -> None:
    """An arrow's head that points against `way`."""
    at, along = np.asarray(tip, float), np.asarray(way, float)
    over = np.array([-along[1], along[0]])
    for side in (-1, 1):
        sheet.line([at, at + 8 * along + 3 * side * over], SOFT, 1.2)
