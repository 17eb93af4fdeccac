"""How much the body is strained, on sections through what moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv

from ...core.arrays import Float, Int
from ...core.mesh import Surface
from . import body_views, color_bar, views
from .color_bar import Scale
from .scene import Scene, Shot, poly
from .sections import Sections
from .sheet import SMALL, Sheet
from .views import View

# By how much the surface that is read misses the true one, on the body.

#: Pixels of a picture that stands beside another.
ERROR_WIDTH, ERROR_HEIGHT = 820, 660


def draw_error_map(surface: Surface, error: Float, frame: Float, scale: Scale) -> str:
    """The deformed surface from two opposite sides, coloured by the error (mm) at its vertices
    (n,); PNG as a data URI."""
    mesh = poly(surface)
    mesh.point_data["error"] = error
    with Scene() as scene:
        scene.colored(mesh, "error", scale.colors, scale.top)
        return body_views.picture(
            [body_views.Seen(scene, v) for v in (views.three_quarter(frame), views.behind(frame))],
            footer=(color_bar.HEIGHT, _bar(scale)),
            width=ERROR_WIDTH,
            height=ERROR_HEIGHT,
            least=1.0,
        )


def _bar(scale: Scale) -> body_views.Footer:
    def draw(sheet: Sheet, x: float, y: float, width: float) -> None:
        color_bar.draw(sheet, scale, x + 0.15 * width, y, 0.7 * width)

    return draw


# Quadratic tets cut by a plane.

#: Eight linear tets in a quadratic one, by the numbers that VTK gives its nodes.
_EIGHT = np.array([[0, 4, 6, 7], [1, 5, 4, 8], [2, 6, 5, 9], [3, 7, 9, 8],
                   [4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5]])  # fmt: skip


def cut_mesh(
    nodes: Float, cells: Int, origin: Float, normal: Float, data: Mapping[str, Float]
) -> Any:
    """The plane's section through nodes (n, 3) mm and quadratic `cells` (m, 10), as a pyvista mesh
    with the node `data` on it. Only cells that the plane meets are looked at."""
    side = (nodes - origin) @ normal
    of = side[cells]
    met = cells[(of.min(1) <= 0) & (of.max(1) >= 0)]
    tets = met[:, _EIGHT].reshape(-1, 4)
    of = side[tets]
    tets = tets[(of.min(1) <= 0) & (of.max(1) >= 0)]
    used, small = np.unique(tets, return_inverse=True)
    if not len(used):
        return pv.PolyData()
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: small.reshape(-1, 4)}, nodes[used])
    for name, values in data.items():
        grid.point_data[name] = values[used]
    return grid.slice(normal=tuple(normal), origin=tuple(origin))


#: Pixels of a picture that stands beside another.
WIDTH, HEIGHT = 820, 760
#: Letters and colours of the planes.
PLANES = (("A", "#d55e00"), ("B", "#0072b2"), ("C", "#7a4f9a"))
_ALONG = np.cos(np.radians(15))  # of two directions that are taken to be the same
_KEY, _TALL_KEY = 150.0, 240.0  # pixels: height of the small picture of the planes
_LETTER = 24.0


@dataclass(frozen=True)
class StrainField:
    """A state: `nodes` (n, 3) mm at rest, quadratic `cells` (m, 10), `displacement` (n, 3) mm,
    largest principal `strain` (n,)."""

    nodes: Float
    cells: Int
    displacement: Float
    strain: Float


def strain_sections(
    field: StrainField,
    rest: Surface,
    moved: Float,
    planes: Sections,
    frame: Float,
    scale: Scale,
) -> str:
    """Three sections, deformed and coloured by the strain in per cent, within the outline of the
    body, whose surface is at `rest` or has its vertices `moved` (v, 3) mm away; below, the scale
    and the planes in the body at rest. PNG as a data URI."""
    data = {"strain": 100 * field.strain, "displacement": field.displacement}
    body = Surface(rest.vertices + moved, rest.faces)
    with Scene() as a, Scene() as b, Scene() as c, Scene() as key:
        for scene, plane in zip((a, b, c), planes.all, strict=True):
            scene.outline(body)
            cut = cut_mesh(field.nodes, field.cells, plane.origin, plane.normal, data)
            if cut.n_points:
                cut = cut.warp_by_vector("displacement")
                scene.colored(cut, "strain", scale.colors, scale.top, lit=False)
        ends = _draw_key(key, rest, planes)
        view = views.three_quarter(frame)
        wide, high = np.ptp(key.extent(view), axis=0)
        room = _TALL_KEY if high > wide else _KEY
        return body_views.picture(
            [
                body_views.Seen(scene, _view(letter, plane.normal, frame), color=color)
                for scene, (letter, color), plane in zip((a, b, c), PLANES, planes.all, strict=True)
            ],
            footer=(room, _footer(scale, key, view, ends, room)),
            width=WIDTH,
            height=HEIGHT + room - _KEY,
            least=1.0,
        )


def _draw_key(key: Scene, rest: Surface, planes: Sections) -> list[Float]:
    """The body at rest with the planes' outlines in it, whose points (n, 3) mm it gives."""
    key.outline(rest, opacity=0.25)
    found = []
    for (_, color), plane in zip(PLANES, planes.all, strict=True):
        line = poly(rest).slice(normal=tuple(plane.normal), origin=tuple(plane.origin))
        found.append(np.asarray(line.points, float))
        if line.n_points:
            key.mesh(line, found[-1], color=color, line_width=2.5, lighting=False)
    return found


def _footer(
    scale: Scale, key: Scene, view: View, ends: list[Float], room: float
) -> body_views.Footer:
    """The scale at the left, the planes at the right."""

    def draw(sheet: Sheet, x: float, y: float, width: float) -> None:
        color_bar.draw(sheet, scale, x + 24, y + room - 130, 0.6 * width - 72)
        shot = key.shot(view, 0.38 * width - 2 * _LETTER, room - 2 * _LETTER)
        at = np.array([x + 0.8 * width - shot.size[0] / 2, y + (room - shot.size[1]) / 2])
        sheet.paste(shot.image, at)
        for k, ((letter, color), points) in enumerate(zip(PLANES, ends, strict=True)):
            if len(points):
                _point_at(sheet, shot, at, points, k, letter, color)

    return draw


def _point_at(
    sheet: Sheet, shot: Shot, at: Float, points: Float, side: int, letter: str, color: str
) -> None:
    """A plane's letter beside the small picture: to the left, the right, or above it."""
    pixels = shot.pixel(points)
    order = (-pixels[:, 0], pixels[:, 0], -pixels[:, 1])[side]
    tip, (width, _) = pixels[order.argmax()], shot.size
    gap = _LETTER / 2
    place = np.array([(-gap, tip[1]), (width + gap, tip[1]), (tip[0], -gap)][side])
    sheet.line([at + tip, at + 0.75 * place + 0.25 * tip], color, 1.0)
    sheet.text(at + place, letter, SMALL, color, bold=True)


def _view(letter: str, normal: Float, frame: Float) -> View:
    """Square to a plane, from the side that is nearer to the front, the right or above."""
    right, up, back = frame
    if normal @ (back + 0.3 * right + 0.2 * up) < 0:
        normal = -normal
    words = {"the front": back, "the right": right, "above": up, "the left": -right}
    words |= {"behind": -back, "below": -up}
    side = next((w for w, way in words.items() if normal @ way > _ALONG), "")
    title = f"{letter}: seen from {side}" if side else f"{letter}: seen at an angle"
    return views.looking(normal, up if abs(normal @ up) < _ALONG else -back, title)
