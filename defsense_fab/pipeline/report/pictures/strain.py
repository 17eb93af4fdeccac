"""How much the body is strained, on sections through what moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....core.arrays import Float, Int
from ....core.mesh import Surface
from . import body_views, color_bar, views
from .color_bar import Scale
from .mesh_cut import mesh_cut
from .scene import Scene, poly
from .sections import Sections
from .sheet import SMALL, Sheet
from .views import View

#: Pixels of a picture that stands beside another.
WIDTH, HEIGHT = 820, 660
#: Colours of the two planes.
PLANES = (("A", "#d55e00"), ("B", "#0072b2"))
_ALONG = np.cos(np.radians(15))  # of two directions that are taken to be the same
_KEY = 150.0  # pixels: height of the small picture of the planes
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
    name: str,
    frame: Float,
    scale: Scale,
) -> str:
    """Both sections, deformed and coloured by the strain in per cent, within the outline of the
    body, whose surface is at `rest` or has its vertices `moved` (v, 3) mm away; below, the scale
    and the planes in the body at rest. PNG as a data URI."""
    normals = (planes.main, planes.second)
    data = {"strain": 100 * field.strain, "displacement": field.displacement}
    body = Surface(rest.vertices + moved, rest.faces)
    with Scene() as first, Scene() as second, Scene() as key:
        for scene, normal in zip((first, second), normals, strict=True):
            scene.outline(body)
            cut = mesh_cut(field.nodes, field.cells, planes.origin, normal, data)
            if cut.n_points:
                cut = cut.warp_by_vector("displacement")
                scene.colored(cut, "strain", scale.colors, scale.top, lit=False)
        ends = _draw_key(key, rest, planes)
        return body_views.picture(
            [
                body_views.Seen(scene, _view(letter, normal, frame), color=color)
                for scene, (letter, color), normal in zip(
                    (first, second), PLANES, normals, strict=True
                )
            ],
            title=name,
            footer=(_KEY, _footer(scale, key, views.three_quarter(frame), ends)),
            width=WIDTH,
            height=HEIGHT,
        )


def _draw_key(key: Scene, rest: Surface, planes: Sections) -> list[Float]:
    """The body at rest with both planes' outlines in it, whose points (n, 3) mm it gives."""
    key.outline(rest, opacity=0.25)
    found = []
    for (_, color), normal in zip(PLANES, (planes.main, planes.second), strict=True):
        line = poly(rest).slice(normal=tuple(normal), origin=tuple(planes.origin))
        found.append(np.asarray(line.points, float))
        if line.n_points:
            key.mesh(line, found[-1], color=color, line_width=3, lighting=False)
    return found


def _footer(scale: Scale, key: Scene, view: View, ends: list[Float]) -> body_views.Footer:
    """The scale at the left, the planes at the right."""

    def draw(sheet: Sheet, x: float, y: float, width: float) -> None:
        color_bar.draw(sheet, scale, x + 40, y + 20, 0.6 * width - 80)
        shot = key.shot(view, 0.38 * width - 2 * _LETTER, _KEY - 2 * _LETTER)
        at = np.array([x + 0.8 * width - shot.size[0] / 2, y + (_KEY - shot.size[1]) / 2])
        sheet.paste(shot.image, at)
        for (letter, color), points, side in zip(PLANES, ends, (-1, 1), strict=True):
            if len(points):
                pixels = shot.pixel(points)
                tip = pixels[(side * pixels[:, 0]).argmax()]
                # Beside the picture, at the height of the outline's end.
                place = [shot.size[0] + _LETTER / 2 if side > 0 else -_LETTER / 2, tip[1]]
                sheet.line([at + tip, at + place], color, 1.0)
                sheet.text(at + place, letter, SMALL, color, bold=True)

    return draw


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
