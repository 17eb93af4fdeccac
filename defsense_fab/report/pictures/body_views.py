"""A scene from the sides that show it: panels with axes and dimensions, as one picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface
from . import views
from .scene import Scene, Shot
from .sheet import COLORS, SMALL, SOFT, Place, Sheet, extent
from .views import View

# The body with its cords.

_DRAWN = "#777777"


def draw_routing(
    surface: Surface, cords: Sequence[Float], drawn: Sequence[Float], radius: float, frame: Float
) -> str:
    """The body with its cords (p, 3) mm from three sides, and how large it is; the paths as drawn
    are thin and grey. `frame` (3, 3) says how it stands. PNG as a data URI."""
    bounds = surface.bounds
    with routing_scene(surface, cords, drawn, radius) as drawing:
        return picture(
            [
                Seen(drawing, views.three_quarter(frame)),
                *(Seen(drawing, v, bounds) for v in views.elevations(frame, bounds)),
            ]
        )


def routing_scene(
    surface: Surface, cords: Sequence[Float], drawn: Sequence[Float], radius: float
) -> Scene:
    """The same, to be seen from anywhere; it is to be closed."""
    drawing = Scene()
    drawing.outline(surface, opacity=0.25)
    for path in drawn:
        drawing.line(path, _DRAWN, 1.5)
    for i, path in enumerate(cords):
        drawing.tube(path, COLORS[i % len(COLORS)], radius)
    return drawing


# Panels of one scale arranged in a picture: what fits, as large as it can be.

#: Pixels that a picture has across at most.
WIDTH = 1100


@dataclass(frozen=True)
class Panel:
    """What a drawing needs: `size` (2,) mm, and `rim` pixels around it to the left, top, right and
    bottom, for what is written there; it is at least `least` pixels wide, rim and all."""

    size: Float
    rim: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    least: float = 0.0

    def pixels(self, scale: float) -> Float:
        """Width and height at so many pixels a mm, with the rim."""
        left, top, right, bottom = self.rim
        wide, high = np.asarray(self.size) * scale + [left + right, top + bottom]
        return np.array([max(wide, self.least), high])


@dataclass(frozen=True)
class Arrangement:
    """`scale` in pixels a mm, the `size` of the whole in pixels, and the top left corner (2,) of
    the room of each panel and the room's size (2,)."""

    scale: float
    size: tuple[float, float]
    corners: tuple[Float, ...]
    rooms: tuple[Float, ...]


#: Panels by their number in rows, which stand below each other.
Rows = Sequence[Sequence[int]]
_THREE: tuple[Rows, ...] = (((0, 1, 2),), ((0,), (1, 2)), ((0,), (1,), (2,)), ((0, 1), (2,)))
_WAYS: dict[int, tuple[Rows, ...]] = {1: (((0,),),), 2: (((0, 1),), ((0,), (1,))), 3: _THREE}
_SPACE = 24.0


def arrange_panels(
    panels: Sequence[Panel], width: float, height: float, most: float = np.inf
) -> Arrangement:
    """Up to three panels in rows or columns, whichever lets them be largest, in a picture of at
    most so many pixels; `most` is the largest scale."""
    found = [_in_rows(panels, rows, width, height, most) for rows in _WAYS[len(panels)]]
    return max(found, key=lambda a: (round(a.scale, 6), -a.size[0] * a.size[1]))


def _in_rows(
    panels: Sequence[Panel], rows: Rows, width: float, height: float, most: float
) -> Arrangement:
    def need(scale: float) -> Float:
        sizes = [[panels[i].pixels(scale) for i in row] for row in rows]
        wide = max(sum(s[0] for s in row) + _SPACE * (len(row) - 1) for row in sizes)
        high = sum(max(s[1] for s in row) for row in sizes) + _SPACE * (len(rows) - 1)
        return np.array([wide, high])

    scale = _largest(lambda s: bool((need(s) <= [width, height]).all()), most)
    total = need(scale)
    corners: dict[int, Float] = {}
    rooms: dict[int, Float] = {}
    y = 0.0
    for row in rows:
        sizes = [panels[i].pixels(scale) for i in row]
        high = max(s[1] for s in sizes)
        spare = total[0] - sum(s[0] for s in sizes)
        x, gap = spare / (len(row) + 1), spare / (len(row) + 1)
        if len(row) > 1 and gap < _SPACE:
            x, gap = 0.0, spare / (len(row) - 1)
        for i, size in zip(row, sizes, strict=True):
            corners[i], rooms[i] = np.array([x, y + high - size[1]]), size
            x += size[0] + gap
        y += high + _SPACE
    order = range(len(panels))
    return Arrangement(
        scale,
        (float(total[0]), float(total[1])),
        tuple(corners[i] for i in order),
        tuple(rooms[i] for i in order),
    )


def _largest(fits: Callable[[float], bool], most: float) -> float:
    """The largest scale that fits (bisection); next to nothing where none does."""
    low, high = 1e-6, min(most, 1e3)
    if fits(high):
        return high
    for _ in range(40):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


# Dimension lines around a straight view of a body.

#: Pixels below a view and to the left of it that a line with its number takes.
BELOW, BESIDE = 44.0, 22.0
_AWAY, _TICK = 14.0, 6.0


def format_length(length: float) -> str:
    """A length in mm as it is written at its line."""
    return f"{length:.0f} mm" if length >= 99.5 else f"{length:.1f} mm"


def height_label_width(height: float) -> float:
    """Pixels to the left of a view for the line of its height, mm."""
    return BESIDE + extent(format_length(height), SMALL)[0] + 6


def draw_width(sheet: Sheet, corner: Place, size: Place, length: float) -> None:
    """The width below a drawing of `size` pixels with its top left at `corner`."""
    (x, y), (w, h) = corner, size
    level = y + h + _AWAY
    for at, way in ((x, 1), (x + w, -1)):
        sheet.line([(at, y + h + 2), (at, level + _TICK)], SOFT, 1)
        _head(sheet, (at, level), (way, 0))
    sheet.line([(x, level), (x + w, level)], SOFT, 1)
    sheet.text((x + w / 2, level + 6 + SMALL / 2), format_length(length), SMALL)


def draw_height(sheet: Sheet, corner: Place, size: Place, length: float) -> None:
    """The height to the left of a drawing."""
    (x, y), (_, h) = corner, size
    level = x - _AWAY
    for at, way in ((y, 1), (y + h, -1)):
        sheet.line([(x - 2, at), (level - _TICK, at)], SOFT, 1)
        _head(sheet, (level, at), (0, way))
    sheet.line([(level, y), (level, y + h)], SOFT, 1)
    sheet.text((level - 9, y + h / 2), format_length(length), SMALL, anchor="rm")


def _head(sheet: Sheet, tip: Place, way: Place) -> None:
    """An arrow's head that points against `way`."""
    at, along = np.asarray(tip, float), np.asarray(way, float)
    over = np.array([-along[1], along[0]])
    for side in (-1, 1):
        sheet.line([at, at + 8 * along + 3 * side * over], SOFT, 1.2)


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
    plan = arrange_panels(panels, width - 8, height - foot)
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
        left, bottom = height_label_width(float(sizes[1])), FOOT + BELOW
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
    draw_width(sheet, low, size, float(wide))
    draw_height(sheet, low, size, float(high))
