"""Draw bodies from several sides in one picture: panels with axes, dimensions and routed cords."""

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

#: Largest width of a picture, pixels.
WIDTH = 1100
#: Height below a panel for its axes and its title, pixels.
FOOT = 62.0
_MAX_HEIGHT_PX = 760
_AXES_SIZE_PX = 58.0
_TITLE_FONT_PX = SMALL - 2
_PANEL_GAP_PX = 24.0
_DIMENSION_HEIGHT_PX, _DIMENSION_WIDTH_PX = 44.0, 22.0  # below and to the left of a view
_DIMENSION_DISTANCE_PX, _TICK_LENGTH_PX = 14.0, 6.0
_DRAWN_PATH_COLOR = "#777777"

#: Draws the foot of a picture: the sheet, its left and upper edge and its width in pixels.
Footer = Callable[[Sheet, float, float, float], None]
#: Indices of panels by row, from top to bottom.
Rows = Sequence[Sequence[int]]
_ROWS_OF_THREE: tuple[Rows, ...] = (
    ((0, 1, 2),),
    ((0,), (1, 2)),
    ((0,), (1,), (2,)),
    ((0, 1), (2,)),
)
_ROWS_BY_COUNT: dict[int, tuple[Rows, ...]] = {
    1: (((0,),),),
    2: (((0, 1),), ((0,), (1,))),
    3: _ROWS_OF_THREE,
}


@dataclass(frozen=True)
class SceneView:
    """A view of a scene in a picture.

    Attributes:
        scene: The scene.
        view: The view.
        sizes: Bounds (2, 3) of the body in mm, to draw its dimensions, which only straight views
            show; None draws none.
        color: Color of the title.
    """

    scene: Scene
    view: View
    sizes: Float | None = None
    color: str = SOFT


@dataclass(frozen=True)
class Panel:
    """Space that a drawing needs.

    Attributes:
        size: Width and height (2,) of the drawing, mm.
        rim: Space for texts to the left, top, right and bottom, pixels.
        min_width: Smallest width with its rim, pixels.
    """

    size: Float
    rim: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    min_width: float = 0.0

    def pixels(self, scale: float) -> Float:
        """Return width and height with the rim at a scale in pixels per mm."""
        left, top, right, bottom = self.rim
        width, height = np.asarray(self.size) * scale + [left + right, top + bottom]
        return np.array([max(width, self.min_width), height])


@dataclass(frozen=True)
class Arrangement:
    """Places of panels in a picture.

    Attributes:
        scale: Scale of all panels, pixels per mm.
        size: Width and height of the picture, pixels.
        corners: Top left (2,) of each panel's room, pixels.
        rooms: Width and height (2,) of each panel's room, pixels.
    """

    scale: float
    size: tuple[float, float]
    corners: tuple[Float, ...]
    rooms: tuple[Float, ...]


def draw_routing(
    surface: Surface, cords: Sequence[Float], drawn: Sequence[Float], radius: float, frame: Float
) -> str:
    """Draw a body with its cords from three sides, with its dimensions.

    Args:
        surface: Surface of the body.
        cords: Path (p, 3) of each cord, mm.
        drawn: Paths (p, 3) that the user drew, mm; they are thin and gray.
        radius: Radius of the cords, mm.
        frame: Axes (3, 3) to the right, up and towards the viewer, one a row.

    Returns:
        A PNG data URI.
    """
    bounds = surface.bounds
    with routing_scene(surface, cords, drawn, radius) as scene:
        return picture(
            [
                SceneView(scene, views.three_quarter(frame)),
                *(SceneView(scene, v, bounds) for v in views.elevations(frame, bounds)),
            ]
        )


def routing_scene(
    surface: Surface, cords: Sequence[Float], drawn: Sequence[Float], radius: float
) -> Scene:
    """Return a scene with a body and its cords, as `draw_routing` draws it; close it after use."""
    scene = Scene()
    scene.outline(surface, opacity=0.25)
    for path in drawn:
        scene.line(path, _DRAWN_PATH_COLOR, 1.5)
    for i, path in enumerate(cords):
        scene.tube(path, COLORS[i % len(COLORS)], radius)
    return scene


def picture(
    scene_views: Sequence[SceneView],
    footer: tuple[float, Footer] | None = None,
    width: float = WIDTH,
    height: float = _MAX_HEIGHT_PX,
    min_width_share: float = 0.6,
) -> str:
    """Draw up to three views at one scale, next to or below each other.

    Args:
        scene_views: The views.
        footer: Height of the foot in pixels, and the function that draws it.
        width: Largest width, pixels.
        height: Largest height, pixels.
        min_width_share: Smallest width, as a share of `width`.

    Returns:
        A PNG data URI.
    """
    panels = [_panel(v) for v in scene_views]
    foot = footer[0] if footer else 0.0
    plan = arrange_panels(panels, width - 8, height - foot)
    sheet_width = max(plan.size[0] + 8, min_width_share * width)
    sheet = Sheet(sheet_width, plan.size[1] + foot + 4)
    shift = np.array([(sheet_width - plan.size[0]) / 2, 0.0])
    for item, panel, corner, room in zip(
        scene_views, panels, plan.corners, plan.rooms, strict=True
    ):
        left, top, right, bottom = panel.rim
        inside = room - [left + right, top + bottom]
        shot = item.scene.shot(item.view, *np.maximum(inside, 8))
        # A drawing that is narrower than its title is centered.
        margin = max(0.0, inside[0] - shot.size[0]) / 2
        at = corner + shift + [left + margin, top]
        sheet.paste(shot.image, at)
        below = float(corner[1] + shift[1] + room[1] - FOOT)
        x = float(corner[0] + shift[0])
        _write_title(sheet, item, x, below, float(room[0]), left + margin)
        if item.sizes is not None:
            _draw_dimensions(sheet, shot, at, item.sizes)
    if footer:
        footer[1](sheet, 0.0, sheet.size[1] - foot, float(sheet.size[0]))
    return sheet.uri()


def _panel(item: SceneView) -> Panel:
    low, high = item.scene.extent(item.view)
    left, bottom = 0.0, FOOT
    if item.sizes is not None:
        sizes = np.ptp(item.view.flat(item.sizes), axis=0)
        left, bottom = _dimension_width(float(sizes[1])), FOOT + _DIMENSION_HEIGHT_PX
    min_width = _AXES_SIZE_PX + 8 + extent(item.view.title, _TITLE_FONT_PX)[0]
    return Panel(high - low, (left, 4.0, 4.0, bottom), min_width)


def _write_title(
    sheet: Sheet, item: SceneView, x: float, y: float, width: float, indent: float
) -> None:
    """Draw the axes of a view and its title below it."""
    title_width = extent(item.view.title, _TITLE_FONT_PX)[0]
    x += min(indent, max(0.0, width - title_width - _AXES_SIZE_PX - 8))
    sheet.axes(item.view, (x, y + 2), _AXES_SIZE_PX)
    place = (x + _AXES_SIZE_PX + 8, y + FOOT / 2)
    sheet.text(place, item.view.title, _TITLE_FONT_PX, item.color, anchor="lm")


def arrange_panels(
    panels: Sequence[Panel], width: float, height: float, max_scale: float = np.inf
) -> Arrangement:
    """Arrange up to three panels in rows so that they are as large as possible.

    Args:
        panels: The panels; all have one scale.
        width: Largest width of the picture, pixels.
        height: Largest height of the picture, pixels.
        max_scale: Largest scale, pixels per mm.

    Returns:
        The arrangement with the largest scale; of those with the same, the smallest one.
    """
    arrangements = [
        _arrange_rows(panels, rows, width, height, max_scale)
        for rows in _ROWS_BY_COUNT[len(panels)]
    ]
    return max(arrangements, key=lambda a: (round(a.scale, 6), -a.size[0] * a.size[1]))


def _arrange_rows(
    panels: Sequence[Panel], rows: Rows, width: float, height: float, max_scale: float
) -> Arrangement:
    def total_size(scale: float) -> Float:
        sizes = [[panels[i].pixels(scale) for i in row] for row in rows]
        total_width = max(sum(s[0] for s in row) + _PANEL_GAP_PX * (len(row) - 1) for row in sizes)
        total_height = sum(max(s[1] for s in row) for row in sizes)
        return np.array([total_width, total_height + _PANEL_GAP_PX * (len(rows) - 1)])

    scale = _largest_scale(lambda s: bool((total_size(s) <= [width, height]).all()), max_scale)
    total = total_size(scale)
    corners: dict[int, Float] = {}
    rooms: dict[int, Float] = {}
    y = 0.0
    for row in rows:
        sizes = [panels[i].pixels(scale) for i in row]
        row_height = max(s[1] for s in sizes)
        spare = total[0] - sum(s[0] for s in sizes)
        x, gap = spare / (len(row) + 1), spare / (len(row) + 1)
        if len(row) > 1 and gap < _PANEL_GAP_PX:
            x, gap = 0.0, spare / (len(row) - 1)
        for i, size in zip(row, sizes, strict=True):
            corners[i], rooms[i] = np.array([x, y + row_height - size[1]]), size
            x += size[0] + gap
        y += row_height + _PANEL_GAP_PX
    order = range(len(panels))
    return Arrangement(
        scale,
        (float(total[0]), float(total[1])),
        tuple(corners[i] for i in order),
        tuple(rooms[i] for i in order),
    )


def _largest_scale(fits: Callable[[float], bool], max_scale: float) -> float:
    """Find the largest scale that fits by bisection; if none does, return nearly 0."""
    low, high = 1e-6, min(max_scale, 1e3)
    if fits(high):
        return high
    for _ in range(40):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _draw_dimensions(sheet: Sheet, shot: Shot, at: Float, bounds: Float) -> None:
    """Draw the width and height of a body in a straight view."""
    ends = shot.pixel(bounds) + at
    low, size = ends.min(0), np.ptp(ends, axis=0)
    width, height = np.ptp(shot.view.flat(bounds), axis=0)
    _draw_width(sheet, low, size, float(width))
    _draw_height(sheet, low, size, float(height))


def _format_length(length: float) -> str:
    return f"{length:.0f} mm" if length >= 99.5 else f"{length:.1f} mm"


def _dimension_width(height: float) -> float:
    """Return the width to the left of a view for the dimension of its height in mm, pixels."""
    return _DIMENSION_WIDTH_PX + extent(_format_length(height), SMALL)[0] + 6


def _draw_width(sheet: Sheet, corner: Place, size: Place, length: float) -> None:
    """Draw the dimension of a width in mm below a drawing of `size` pixels."""
    (x, y), (w, h) = corner, size
    level = y + h + _DIMENSION_DISTANCE_PX
    for at, direction in ((x, 1), (x + w, -1)):
        sheet.line([(at, y + h + 2), (at, level + _TICK_LENGTH_PX)], SOFT, 1)
        _draw_arrowhead(sheet, (at, level), (direction, 0))
    sheet.line([(x, level), (x + w, level)], SOFT, 1)
    sheet.text((x + w / 2, level + 6 + SMALL / 2), _format_length(length), SMALL)


def _draw_height(sheet: Sheet, corner: Place, size: Place, length: float) -> None:
    """Draw the dimension of a height in mm to the left of a drawing of `size` pixels."""
    (x, y), (_, h) = corner, size
    level = x - _DIMENSION_DISTANCE_PX
    for at, direction in ((y, 1), (y + h, -1)):
        sheet.line([(x - 2, at), (level - _TICK_LENGTH_PX, at)], SOFT, 1)
        _draw_arrowhead(sheet, (level, at), (0, direction))
    sheet.line([(level, y), (level, y + h)], SOFT, 1)
    sheet.text((level - 9, y + h / 2), _format_length(length), SMALL, anchor="rm")


def _draw_arrowhead(sheet: Sheet, tip: Place, direction: Place) -> None:
    """Draw an arrowhead that points against a direction."""
    at, along = np.asarray(tip, float), np.asarray(direction, float)
    across = np.array([-along[1], along[0]])
    for side in (-1, 1):
        sheet.line([at, at + 8 * along + 3 * side * across], SOFT, 1.2)
