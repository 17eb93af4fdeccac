"""A scene from the sides that show it: panels with axes and dimensions, as one picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from . import dimensions
from .panels import WIDTH, Panel, arranged
from .scene import Scene, Shot
from .sheet import SMALL, SOFT, Sheet, extent
from .views import View

#: Pixels below a panel: its axes, and beside them from where it is seen.
FOOT = 62.0
_AXES = 58.0
_LETTERS = SMALL - 2
_HEIGHT = 760  # pixels of a picture at most


@dataclass(frozen=True)
class Seen:
    """A view of a scene; `sizes` (2, 3) is the body's bounds in mm if its dimensions are to be
    drawn, which only a straight view shows; `color` of its title."""

    scene: Scene
    view: View
    sizes: Float | None = None
    color: str = SOFT


#: Draws at the bottom of a picture: the sheet, the left and the upper end, the width (pixels).
Footer = Callable[[Sheet, float, float, float], None]


def picture(
    seen: Sequence[Seen],
    footer: tuple[float, Footer] | None = None,
    width: float = WIDTH,
    height: float = _HEIGHT,
    least: float = 0.6,
) -> str:
    """Up to three views side by side or below each other, at one scale, as a PNG in a data URI,
    with `footer`'s drawing in so many pixels below; at least `least` of the `width`."""
    panels = [_panel(s) for s in seen]
    foot = footer[0] if footer else 0.0
    plan = arranged(panels, width - 8, height - foot)
    wide = max(plan.size[0] + 8, least * width)
    sheet = Sheet(wide, plan.size[1] + foot + 4)
    shift = np.array([(wide - plan.size[0]) / 2, 0.0])
    for one, panel, corner, room in zip(seen, panels, plan.corners, plan.rooms, strict=True):
        left, top, right, bottom = panel.rim
        inside = room - [left + right, top + bottom]
        shot = one.scene.shot(one.view, *np.maximum(inside, 8))
        # In the middle of what a foot that is wider than the drawing leaves.
        spare = max(0.0, inside[0] - shot.size[0]) / 2
        at = corner + shift + [left + spare, top]
        sheet.paste(shot.image, at)
        below = float(corner[1] + shift[1] + room[1] - FOOT)
        _foot(sheet, one, float(corner[0] + shift[0]), below, float(room[0]), left + spare)
        if one.sizes is not None:
            _dimensions(sheet, shot, at, one.sizes)
    if footer:
        footer[1](sheet, 0.0, sheet.size[1] - foot, float(sheet.size[0]))
    return sheet.uri()


def _panel(seen: Seen) -> Panel:
    low, high = seen.scene.extent(seen.view)
    left, bottom = 0.0, FOOT
    if seen.sizes is not None:
        sizes = np.ptp(seen.view.flat(seen.sizes), axis=0)
        left, bottom = dimensions.room(float(sizes[1])), FOOT + dimensions.BELOW
    least = _AXES + 8 + extent(seen.view.title, _LETTERS)[0]
    return Panel(high - low, (left, 4.0, 4.0, bottom), least)


def _foot(sheet: Sheet, one: Seen, x: float, y: float, room: float, indent: float) -> None:
    words = extent(one.view.title, _LETTERS)[0]
    x += min(indent, max(0.0, room - words - _AXES - 8))
    sheet.axes(one.view, (x, y + 2), _AXES)
    sheet.text((x + _AXES + 8, y + FOOT / 2), one.view.title, _LETTERS, one.color, anchor="lm")


def _dimensions(sheet: Sheet, shot: Shot, at: Float, bounds: Float) -> None:
    """The width and height of a body in a straight view."""
    ends = shot.pixel(bounds) + at
    low, size = ends.min(0), np.ptp(ends, axis=0)
    wide, high = np.ptp(shot.view.flat(bounds), axis=0)
    dimensions.across(sheet, low, size, float(wide))
    dimensions.upright(sheet, low, size, float(high))
