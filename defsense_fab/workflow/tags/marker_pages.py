"""Pages that show which tag goes where: pictures of the body with its tags, and a table."""

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv

from ...capture.tags.print_sheets import paper_size
from ...capture.tags.tag_patterns import dictionary
from ...core.arrays import Bool, Float, format_point
from ...core.markers import Markers
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import cast_ray
from ...report.pictures.scene import Scene
from ...report.pictures.sheet import TEXT, Sheet, extent
from ...report.pictures.views import View, looking

_FACING = 0.45  # cosine: how squarely a picture shows a tag at least
_FEWEST, _MOST = 2, 6
_SIZE, _RIM = (1100, 620), 36  # pixels of a picture, and around the body for numbers
_LABEL = (9, 18)  # pixels: half of a number, and that with some room
_ANCHOR, _OTHER = "#b3001b", "#12355b"
_MM = 72 / 25.4
_MARGIN, _ROW = 18.0, 5.0  # mm


def views(body: Surface, markers: Markers) -> list[tuple[Float, Bool]]:
    """Directions (3,) from the body to the viewer that together show every tag (as far as six can),
    with which of the tags (m,) each shows; found greedily."""
    ways = [np.array(v, float) for v in itertools.product((-1, 0, 1), repeat=3) if any(v)]
    ways = [v / np.linalg.norm(v) for v in ways]
    normals = markers.axes[:, :, 2]
    facing = np.array([normals @ v for v in ways])
    seen = facing >= _FACING
    for i, k in np.argwhere(seen):
        start = markers.centers[k] + 1.5 * normals[k]
        seen[i, k] = not len(cast_ray(start, ways[i], body))
    found: list[int] = []
    left = np.ones(len(markers.ids), bool)
    while len(found) < _MOST and (left.any() or len(found) < _FEWEST):
        new = (seen & left).sum(1) + 1e-3 * (seen * facing).sum(1)
        new[found] = -1
        found.append(int(new.argmax()))
        left &= ~seen[found[-1]]
    return [(ways[i], seen[i]) for i in found]


def picture(body: Surface, markers: Markers, view: Float, seen: Bool) -> bytes:
    """PNG of the body with all tags as they are glued, the numbers of those that are `seen`
    beside them, red on the anchor."""
    way = looking(view, np.array([0, 0, 1.0] if abs(view[2]) < 0.9 else [0, 1.0, 0]))
    tags = dictionary(markers.dictionary)
    lift = max(0.5, 0.08 * markers.size)  # clear of a skin that is not quite flat
    cell = markers.size / (tags.cells + 2)
    half = markers.size / 2 + cell
    square = half * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    with Scene() as scene:
        scene.solid(body, "#c9d6df")
        for number, center, axes in zip(markers.ids, markers.centers, markers.axes, strict=True):
            corners = center + lift * axes[:, 2] + square @ axes[:, :2].T
            quad = pv.PolyData(corners, np.array([4, 0, 1, 2, 3]))
            quad.active_texture_coordinates = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
            pattern = np.pad(tags.pattern(int(number)), 1, constant_values=255)
            image = np.repeat(np.kron(pattern, np.ones((24, 24), np.uint8))[..., None], 3, axis=2)
            scene.mesh(quad, corners, texture=pv.numpy_to_texture(image), lighting=False)
        shot = scene.shot(way, *(np.array(_SIZE) - 2 * _RIM))
    sheet = Sheet(*(np.array(shot.size) + 2 * _RIM))
    sheet.paste(shot.image, (_RIM, _RIM))
    at = _beside(markers, seen, half, way, _LABEL[1] / shot.scale)
    for k in np.flatnonzero(seen):
        place = np.clip(
            shot.pixel(at[k][None])[0] + _RIM, _RIM / 2, np.array(sheet.size) - _RIM / 2
        )
        words = str(markers.ids[k])
        wide = extent(words, TEXT, bold=True)[0] + 8
        color = _ANCHOR if markers.anchor[k] else _OTHER
        sheet.box(place - [wide / 2, _LABEL[0] + 4], (wide, 2 * _LABEL[0] + 8), color)
        sheet.text(place, words, TEXT, "white", bold=True)
    return sheet.png()


def _beside(markers: Markers, seen: Bool, half: float, view: View, room: float) -> Float:
    """Where numbers (m, 3) mm stand: below the pieces, `half` their side, or on that side of them
    where the other tags are farthest."""
    right, up = view.right, view.up
    sides = np.array([-up, up, right, -right])
    reach = half * np.abs(np.einsum("mjk,sj->msk", markers.axes[:, :, :2], sides)).sum(2) + room
    spots = markers.centers[:, None] + reach[..., None] * sides
    screen = np.stack([right, up], axis=1)
    tags = (markers.centers @ screen)[seen]
    gap = np.linalg.norm((spots @ screen)[:, :, None] - tags, axis=3)
    own = np.linalg.norm(markers.centers @ screen - tags[:, None], axis=2).T < 1e-9
    gap = np.where(own[:, None], np.inf, gap).min(2, initial=np.inf)
    best = np.where(gap[:, 0] > 1.6 * half, 0, gap.argmax(1))
    return np.asarray(spots[np.arange(len(spots)), best])


def draw_places(
    canvas: Any,
    body: Surface,
    markers: Markers,
    paper: str,
    notes: Sequence[str],
    anchor: str | None,
) -> None:
    """Add the pages to a canvas."""
    from reportlab.lib.utils import ImageReader

    width, height = paper_size(paper)
    chosen = views(body, markers)
    canvas.setPageSize((width * _MM, height * _MM))
    canvas.scale(_MM, _MM)
    y = _head(canvas, height, f"{markers.device}: where the tags go")
    lines = [
        "Glue each tag where the pictures show it, turned as there."
        + (f" Red: on the anchor ({anchor})." if anchor else ""),
        *(f"Note: {n}" for n in notes),
    ]
    for line in lines:
        y = _lines(canvas, line, y, width)
    wide = width - 2 * _MARGIN
    for n, (view, seen) in enumerate(chosen):
        image = ImageReader(io.BytesIO(picture(body, markers, view, seen)))
        w, h = image.getSize()
        high = wide * h / w
        if y - high - 8 < _MARGIN:
            y = _next(canvas, width, height)
        _say(canvas, _MARGIN, y - 4, f"Picture {n + 1}", 10, bold=True)
        canvas.drawImage(image, _MARGIN, y - 6 - high, wide, high)
        y -= high + 9
    _table(canvas, markers, chosen, width, height, y)
    canvas.showPage()


def _table(
    canvas: Any,
    markers: Markers,
    chosen: Sequence[tuple[Float, Bool]],
    width: float,
    height: float,
    y: float,
) -> None:
    columns = np.array([0.0, 22, 85, 110]) + _MARGIN
    head = ("number", "middle (x, y, z), mm, rest frame", "anchor", "pictures")
    if y - 8 - _ROW * (len(markers.ids) + 1) < _MARGIN:
        y = _next(canvas, width, height)
    rows = [
        (
            str(i),
            format_point(c),
            "yes" if on else "",
            ", ".join(str(n + 1) for n, (_, seen) in enumerate(chosen) if seen[k]) or "-",
        )
        for k, (i, c, on) in enumerate(
            zip(markers.ids, markers.centers, markers.anchor, strict=True)
        )
    ]
    for n, row in enumerate((head, *rows)):
        if y - _ROW < _MARGIN:
            y = _next(canvas, width, height)
        y -= _ROW
        for x, cell in zip(columns, row, strict=True):
            _say(canvas, x, y + 1.5, cell, 9, bold=n == 0)
        canvas.setStrokeGray(0.75)
        canvas.setLineWidth(0.1)
        canvas.line(_MARGIN, y, width - _MARGIN, y)


def _head(canvas: Any, height: float, title: str) -> float:
    _say(canvas, _MARGIN, height - _MARGIN, title, 14, bold=True)
    return height - _MARGIN - 4


def _next(canvas: Any, width: float, height: float) -> float:
    canvas.showPage()
    canvas.setPageSize((width * _MM, height * _MM))
    canvas.scale(_MM, _MM)
    return height - _MARGIN


def _lines(canvas: Any, text: str, y: float, width: float) -> float:
    from reportlab.lib.utils import simpleSplit

    for line in simpleSplit(text, "Helvetica", 9, (width - 2 * _MARGIN) * _MM):
        y -= 4
        _say(canvas, _MARGIN, y, line, 9)
    return y - 1


def _say(canvas: Any, x: float, y: float, text: str, points: float, bold: bool = False) -> None:
    canvas.setFillGray(0)
    canvas.setFont("Helvetica-Bold" if bold else "Helvetica", points / _MM)
    canvas.drawString(x, y, text)
