"""Draw deformed bodies: errors on their surface, and strain in sections."""

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

#: Letters and colors of the sections.
PLANES = (("A", "#d55e00"), ("B", "#0072b2"), ("C", "#7a4f9a"))
#: Size of a picture that is placed next to another one, pixels.
_ERROR_WIDTH_PX, _ERROR_HEIGHT_PX = 820, 660
_STRAIN_WIDTH_PX, _STRAIN_HEIGHT_PX = 820, 760
_KEY_HEIGHT_PX, _TALL_KEY_HEIGHT_PX = 150.0, 240.0  # of the small picture of the planes
_LETTER_SIZE_PX = 24.0
_SAME_DIRECTION_COSINE = np.cos(np.radians(15))
#: Eight linear tetrahedra in a quadratic one, by VTK's numbers of its nodes.
_LINEAR_TETS = np.array(
    [
        [0, 4, 6, 7],
        [1, 5, 4, 8],
        [2, 6, 5, 9],
        [3, 7, 9, 8],
        [4, 9, 5, 6],
        [4, 9, 6, 7],
        [4, 9, 7, 8],
        [4, 9, 8, 5],
    ]
)


def draw_error_map(surface: Surface, error: Float, frame: Float, scale: Scale) -> str:
    """Draw a deformed surface from two opposite sides, colored by its error.

    Args:
        surface: The deformed surface.
        error: Error of each vertex (n,), mm.
        frame: Axes (3, 3) to the right, up and towards the viewer, one a row.
        scale: Scale of the colors.

    Returns:
        A PNG data URI.
    """
    mesh = poly(surface)
    mesh.point_data["error"] = error
    with Scene() as scene:
        scene.colored(mesh, "error", scale.colors, scale.top)
        return body_views.picture(
            [
                body_views.SceneView(scene, v)
                for v in (views.three_quarter(frame), views.behind(frame))
            ],
            footer=(color_bar.HEIGHT, _error_footer(scale)),
            width=_ERROR_WIDTH_PX,
            height=_ERROR_HEIGHT_PX,
            min_width_share=1.0,
        )


def _error_footer(scale: Scale) -> body_views.Footer:
    def draw(sheet: Sheet, x: float, y: float, width: float) -> None:
        color_bar.draw(sheet, scale, x + 0.15 * width, y, 0.7 * width)

    return draw


@dataclass(frozen=True)
class StrainField:
    """Strain of a body in one state.

    Attributes:
        nodes: Nodes (n, 3) at rest, mm.
        cells: Quadratic tetrahedra (m, 10).
        displacement: Displacement of each node (n, 3), mm.
        strain: Largest principal strain of each node (n,).
    """

    nodes: Float
    cells: Int
    displacement: Float
    strain: Float


def strain_sections(
    field: StrainField, rest: Surface, moved: Float, planes: Sections, frame: Float, scale: Scale
) -> str:
    """Draw three deformed sections of a body, colored by strain, within its outline.

    Below are the color bar and the planes in the body at rest.

    Args:
        field: Strain of the body.
        rest: Surface of the body at rest.
        moved: Displacement of the surface's vertices (v, 3), mm.
        planes: The planes of the sections.
        frame: Axes (3, 3) to the right, up and towards the viewer, one a row.
        scale: Scale of the colors, in percent.

    Returns:
        A PNG data URI.
    """
    data = {"strain": 100 * field.strain, "displacement": field.displacement}
    body = Surface(rest.vertices + moved, rest.faces)
    with Scene() as a, Scene() as b, Scene() as c, Scene() as key:
        for scene, plane in zip((a, b, c), planes.all, strict=True):
            scene.outline(body)
            cut = cut_mesh(field.nodes, field.cells, plane.origin, plane.normal, data)
            if cut.n_points:
                cut = cut.warp_by_vector("displacement")
                scene.colored(cut, "strain", scale.colors, scale.top, is_shaded=False)
        outlines = _draw_key(key, rest, planes)
        view = views.three_quarter(frame)
        wide, high = np.ptp(key.extent(view), axis=0)
        key_height = _TALL_KEY_HEIGHT_PX if high > wide else _KEY_HEIGHT_PX
        return body_views.picture(
            [
                body_views.SceneView(scene, _section_view(letter, plane.normal, frame), color=color)
                for scene, (letter, color), plane in zip((a, b, c), PLANES, planes.all, strict=True)
            ],
            footer=(key_height, _strain_footer(scale, key, view, outlines, key_height)),
            width=_STRAIN_WIDTH_PX,
            height=_STRAIN_HEIGHT_PX + key_height - _KEY_HEIGHT_PX,
            min_width_share=1.0,
        )


def _draw_key(key: Scene, rest: Surface, planes: Sections) -> list[Float]:
    """Add the body at rest and the outlines of its sections; return the outlines' points (n, 3)."""
    key.outline(rest, opacity=0.25)
    outlines = []
    for (_, color), plane in zip(PLANES, planes.all, strict=True):
        line = poly(rest).slice(normal=tuple(plane.normal), origin=tuple(plane.origin))
        outlines.append(np.asarray(line.points, float))
        if line.n_points:
            key.mesh(line, outlines[-1], color=color, line_width=2.5, lighting=False)
    return outlines


def _strain_footer(
    scale: Scale, key: Scene, view: View, outlines: list[Float], key_height: float
) -> body_views.Footer:
    """Return a function that draws the color bar at the left and the planes at the right."""

    def draw(sheet: Sheet, x: float, y: float, width: float) -> None:
        color_bar.draw(sheet, scale, x + 24, y + key_height - 130, 0.6 * width - 72)
        shot = key.shot(view, 0.38 * width - 2 * _LETTER_SIZE_PX, key_height - 2 * _LETTER_SIZE_PX)
        at = np.array([x + 0.8 * width - shot.size[0] / 2, y + (key_height - shot.size[1]) / 2])
        sheet.paste(shot.image, at)
        for k, ((letter, color), points) in enumerate(zip(PLANES, outlines, strict=True)):
            if len(points):
                _label_plane(sheet, shot, at, points, k, letter, color)

    return draw


def _label_plane(
    sheet: Sheet, shot: Shot, at: Float, points: Float, side: int, letter: str, color: str
) -> None:
    """Write a plane's letter to the left, to the right or above the small picture."""
    pixels = shot.pixel(points)
    order = (-pixels[:, 0], pixels[:, 0], -pixels[:, 1])[side]
    tip, (width, _) = pixels[order.argmax()], shot.size
    gap = _LETTER_SIZE_PX / 2
    place = np.array([(-gap, tip[1]), (width + gap, tip[1]), (tip[0], -gap)][side])
    sheet.line([at + tip, at + 0.75 * place + 0.25 * tip], color, 1.0)
    sheet.text(at + place, letter, SMALL, color, bold=True)


def _section_view(letter: str, normal: Float, frame: Float) -> View:
    """Return the view square to a plane, from the side closer to the front, right or above."""
    right, up, back = frame
    if normal @ (back + 0.3 * right + 0.2 * up) < 0:
        normal = -normal
    directions = {"the front": back, "the right": right, "above": up, "the left": -right}
    directions |= {"behind": -back, "below": -up}
    side = next(
        (
            name
            for name, direction in directions.items()
            if normal @ direction > _SAME_DIRECTION_COSINE
        ),
        "",
    )
    title = f"{letter}: seen from {side}" if side else f"{letter}: seen at an angle"
    return views.looking(normal, up if abs(normal @ up) < _SAME_DIRECTION_COSINE else -back, title)


def cut_mesh(
    nodes: Float, cells: Int, origin: Float, normal: Float, data: Mapping[str, Float]
) -> Any:
    """Cut a quadratic mesh with a plane.

    Only cells that the plane meets are processed.

    Args:
        nodes: Nodes (n, 3), mm.
        cells: Quadratic tetrahedra (m, 10).
        origin: Point (3,) of the plane, mm.
        normal: Normal (3,) of the plane.
        data: Values of the nodes, by name.

    Returns:
        The section as a pyvista mesh with the data.
    """
    side = (nodes - origin) @ normal
    side_of_nodes = side[cells]
    cut_cells = cells[(side_of_nodes.min(1) <= 0) & (side_of_nodes.max(1) >= 0)]
    tets = cut_cells[:, _LINEAR_TETS].reshape(-1, 4)
    side_of_nodes = side[tets]
    tets = tets[(side_of_nodes.min(1) <= 0) & (side_of_nodes.max(1) >= 0)]
    used_nodes, tet_nodes = np.unique(tets, return_inverse=True)
    if not len(used_nodes):
        return pv.PolyData()
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: tet_nodes.reshape(-1, 4)}, nodes[used_nodes])
    for name, values in data.items():
        grid.point_data[name] = values[used_nodes]
    return grid.slice(normal=tuple(normal), origin=tuple(origin))
