"""By how much the surface that is read misses the true one, on the body."""

from __future__ import annotations

from ....core.arrays import Float
from ....core.mesh import Surface
from .. import body_views, views
from ..scene import Scene, poly
from ..sheet import Sheet
from . import color_bar
from .color_bar import Scale

#: Pixels of a picture that stands beside another.
WIDTH, HEIGHT = 820, 660


def error_map(surface: Surface, error: Float, frame: Float, scale: Scale) -> str:
    """The deformed surface from two opposite sides, coloured by the error (mm) at its vertices
    (n,); PNG as a data URI."""
    mesh = poly(surface)
    mesh.point_data["error"] = error
    with Scene() as scene:
        scene.colored(mesh, "error", scale.colors, scale.top)
        return body_views.picture(
            [body_views.Seen(scene, v) for v in (views.three_quarter(frame), views.behind(frame))],
            footer=(color_bar.HEIGHT, _bar(scale)),
            width=WIDTH,
            height=HEIGHT,
            least=1.0,
        )


def _bar(scale: Scale) -> body_views.Footer:
    def draw(sheet: Sheet, x: float, y: float, width: float) -> None:
        color_bar.draw(sheet, scale, x + 0.15 * width, y, 0.7 * width)

    return draw
