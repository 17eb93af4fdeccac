"""The body with its cords."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.arrays import Float
from ...core.mesh import Surface
from ..colors import COLORS
from . import body_views, views
from .scene import Scene

_DRAWN = "#777777"


def routing(
    surface: Surface, cords: Sequence[Float], drawn: Sequence[Float], radius: float, frame: Float
) -> str:
    """The body with its cords (p, 3) mm from three sides, and how large it is; the paths as drawn
    are thin and grey. `frame` (3, 3) says how it stands. PNG as a data URI."""
    bounds = surface.bounds
    with scene(surface, cords, drawn, radius) as drawing:
        return body_views.picture(
            [
                body_views.Seen(drawing, views.three_quarter(frame)),
                *(body_views.Seen(drawing, v, bounds) for v in views.elevations(frame, bounds)),
            ]
        )


def scene(surface: Surface, cords: Sequence[Float], drawn: Sequence[Float], radius: float) -> Scene:
    """The same, to be seen from anywhere; it is to be closed."""
    drawing = Scene()
    drawing.outline(surface, opacity=0.25)
    for path in drawn:
        drawing.line(path, _DRAWN, 1.5)
    for i, path in enumerate(cords):
        drawing.tube(path, COLORS[i % len(COLORS)], radius)
    return drawing
