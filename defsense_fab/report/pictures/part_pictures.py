"""Draw the parts of a device, moved apart, with labels next to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface
from ...store.manifest import part_label
from . import labels, views
from .body_views import FOOT, WIDTH
from .scene import Scene
from .sheet import COLORS, SMALL, SOFT, TEXT, Sheet
from .views import View

_HEIGHT_PX = 620
_TRIAL_SIZE_PX = 260  # enough to count how much of each part is visible
#: Share of the parts' average visible area; if the least visible part shows more in the first view,
#: that view is taken without trying others.
_CLEAR_SHARE = 0.7
#: Share of the best view's least visible area that makes a view good enough.
_GOOD_ENOUGH_SHARE = 0.6


def exploded(parts: Mapping[str, Surface], shifts: Mapping[str, Float], frame: Float) -> str:
    """Draw an exploded view with the names of the parts.

    Args:
        parts: Surfaces of the parts, by name.
        shifts: Displacement (3,) of each part, mm.
        frame: Axes (3, 3) to the right, up and towards the viewer, one a row.

    Returns:
        A PNG data URI.
    """
    colors = {n: COLORS[i % len(COLORS)] for i, n in enumerate(parts)}
    shifted = {n: Surface(s.vertices + shifts[n], s.faces) for n, s in parts.items()}
    with Scene() as scene:
        for name, surface in shifted.items():
            scene.solid(surface, colors[name], name=name)
        candidates = [views.three_quarter(frame), *views.around(frame)]
        view = choose_clearest_view(scene, candidates, list(parts))
        centers = {n: s.bounds.mean(0) for n, s in shifted.items()}
        return draw_labelled_parts(scene, view, colors, centers)


def choose_clearest_view(scene: Scene, candidates: Sequence[View], names: Sequence[str]) -> View:
    """Choose the first view in which every part is about as visible as it can be.

    Args:
        scene: The scene.
        candidates: Views in order of preference.
        names: Names of the shapes that should be visible.

    Returns:
        The first view whose least visible shape shows nearly as much as in the best view.
    """
    min_areas: list[float] = []
    for view in candidates:
        scene.shot(view, _TRIAL_SIZE_PX, _TRIAL_SIZE_PX)
        masks = scene.visible_areas()
        areas = [float(masks[n].sum()) for n in names]
        if not min_areas and min(areas) >= _CLEAR_SHARE * sum(areas) / len(areas):
            return view
        min_areas.append(min(areas))
    enough = _GOOD_ENOUGH_SHARE * max(min_areas)
    return next(v for v, area in zip(candidates, min_areas, strict=True) if area >= enough)


def draw_labelled_parts(
    scene: Scene,
    view: View,
    colors: Mapping[str, str],
    centers: Mapping[str, Float],
    title: str = "",
    width: float = WIDTH,
    height: float = _HEIGHT_PX,
) -> str:
    """Draw a scene with a label for each of its named shapes.

    A label points at the visible area of its shape, or, with "(behind)", at its center.

    Args:
        scene: The scene.
        view: The view.
        colors: Colors of the labels, by the shapes' names.
        centers: Centers (3,) of the shapes, mm.
        title: Title of the picture.
        width: Largest width, pixels.
        height: Largest height, pixels.

    Returns:
        A PNG data URI.
    """
    names = list(colors)
    column_width = labels.room(
        f"{part_label(n)} (behind)" if len(names) > 1 else part_label(n) for n in names
    )
    head = 1.7 * TEXT if title else 0.0
    labels_height = 1.5 * SMALL * -(-len(names) // 2)  # of a column
    shot = scene.shot(view, width - 2 * column_width - 8, height - head - FOOT - 12)
    masks = scene.visible_areas()
    anchors, texts, label_colors = [], [], []
    for name in names:
        at = labels.spot(masks[name]) if name in masks else None
        is_hidden = at is None
        anchors.append(shot.pixel(centers[name][None])[0] if is_hidden else np.array(at))
        texts.append(f"{part_label(name)} (behind)" if is_hidden else part_label(name))
        label_colors.append(colors[name])
    w, h = shot.size
    left, right = labels.widths(texts, np.array(anchors), shot.size)
    margin = max(0.0, labels_height - h) / 2
    sheet_width = max(0.6 * width, left + w + right + 8)
    sheet = Sheet(sheet_width, head + h + 2 * margin + FOOT + 12)
    corner = np.array([left + (sheet.size[0] - left - w - right) / 2, head + margin + 6])
    sheet.paste(shot.image, corner)
    labels.write(sheet, texts, np.array(anchors), corner, shot.size, label_colors, FOOT)
    sheet.axes(view, (6, sheet.size[1] - FOOT + 2))
    if view.title:
        sheet.text((66, sheet.size[1] - FOOT / 2), view.title, SMALL - 2, SOFT, anchor="lm")
    if title:
        sheet.text((6, head / 2), title, TEXT, anchor="lm", bold=True)
    return sheet.uri()
