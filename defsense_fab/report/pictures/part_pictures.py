"""The parts of a device, moved apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface
from . import labels, views
from .body_views import FOOT, WIDTH
from .scene import Scene
from .sheet import COLORS, SMALL, SOFT, TEXT, Sheet
from .views import View

# A scene with the names of its parts beside it.

_HEIGHT = 620
_SMALL_SHOT = 260  # pixels: enough to see how much of each part shows
_CLEAR = 0.7  # of what a part shows on average: enough of the least for the first view to be taken
_ENOUGH = 0.6  # of the best view's: how much of its least visible part the first has to show


def draw_labelled_parts(
    scene: Scene,
    view: View,
    colors: Mapping[str, str],
    centers: Mapping[str, Float],
    title: str = "",
    width: float = WIDTH,
    height: float = _HEIGHT,
) -> str:
    """The scene with a label for each of its things whose name is in `colors`, at a place where it
    is seen, or, with "(behind)", at its center (3,) mm; PNG as a data URI."""
    names = list(colors)
    column = labels.room(f"{n} (behind)" if len(names) > 1 else n for n in names)
    head = 1.7 * TEXT if title else 0.0
    needed = 1.5 * SMALL * -(-len(names) // 2)  # by the labels of a column
    shot = scene.shot(view, width - 2 * column - 8, height - head - FOOT - 12)
    seen = scene.seen()
    anchors, words, used = [], [], []
    for name in names:
        at = labels.spot(seen[name]) if name in seen else None
        hidden = at is None
        anchors.append(shot.pixel(centers[name][None])[0] if hidden else np.array(at))
        words.append(f"{name} (behind)" if hidden else name)
        used.append(colors[name])
    w, h = shot.size
    left, right = labels.widths(words, np.array(anchors), shot.size)
    spare = max(0.0, needed - h) / 2
    least = max(0.6 * width, left + w + right + 8)
    sheet = Sheet(least, head + h + 2 * spare + FOOT + 12)
    corner = np.array([left + (sheet.size[0] - left - w - right) / 2, head + spare + 6])
    sheet.paste(shot.image, corner)
    labels.write(sheet, words, np.array(anchors), corner, shot.size, used, FOOT)
    sheet.axes(view, (6, sheet.size[1] - FOOT + 2))
    if view.title:
        sheet.text((66, sheet.size[1] - FOOT / 2), view.title, SMALL - 2, SOFT, anchor="lm")
    if title:
        sheet.text((6, head / 2), title, TEXT, anchor="lm", bold=True)
    return sheet.uri()


def choose_clearest_view(scene: Scene, views: Sequence[View], names: Sequence[str]) -> View:
    """Of some views the first that shows of every named thing about as much as any of them does of
    the one that it shows least."""
    least: list[float] = []
    for view in views:
        scene.shot(view, _SMALL_SHOT, _SMALL_SHOT)
        seen = scene.seen()
        shown = [float(seen[n].sum()) for n in names]
        if not least and min(shown) >= _CLEAR * sum(shown) / len(shown):
            return view
        least.append(min(shown))
    enough = _ENOUGH * max(least)
    return next(v for v, some in zip(views, least, strict=True) if some >= enough)


def exploded(parts: Mapping[str, Surface], shifts: Mapping[str, Float], frame: Float) -> str:
    """The parts, each moved by its shift (3,) mm, with their names, from the side that shows them
    best. `frame` (3, 3) says how the body stands."""
    colors = {n: COLORS[i % len(COLORS)] for i, n in enumerate(parts)}
    moved = {n: Surface(s.vertices + shifts[n], s.faces) for n, s in parts.items()}
    with Scene() as scene:
        for name, surface in moved.items():
            scene.solid(surface, colors[name], name=name)
        sides = [views.three_quarter(frame), *views.around(frame)]
        view = choose_clearest_view(scene, sides, list(parts))
        centers = {n: s.bounds.mean(0) for n, s in moved.items()}
        return draw_labelled_parts(scene, view, colors, centers)
