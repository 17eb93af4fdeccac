"""Draw pages that show where tags go: pictures of the body with its tags, and a table."""

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

MIN_FACING = 0.45  # cosine of the angle between a tag and the viewer
MIN_VIEWS, MAX_VIEWS = 2, 6
PICTURE_PX, RIM_PX = (1100, 620), 36  # of a picture, and around the body for numbers
LABEL_PX = (9, 18)  # half of a number, and the same with some room
ANCHOR_COLOR, TAG_COLOR = "#b3001b", "#12355b"
POINTS_PER_MM = 72 / 25.4
MARGIN_MM, ROW_MM = 18.0, 5.0


def choose_views(body: Surface, markers: Markers) -> list[tuple[Float, Bool]]:
    """Choose directions of pictures that together show every tag, as far as six can.

    They are chosen greedily.

    Returns:
        Directions (3,) from the body to the viewer, each with which tags (m,) it shows.
    """
    directions = [np.array(v, float) for v in itertools.product((-1, 0, 1), repeat=3) if any(v)]
    directions = [v / np.linalg.norm(v) for v in directions]
    normals = markers.axes[:, :, 2]
    facing = np.array([normals @ v for v in directions])
    visible = facing >= MIN_FACING
    for i, k in np.argwhere(visible):
        start = markers.centers[k] + 1.5 * normals[k]
        visible[i, k] = not len(cast_ray(start, directions[i], body))
    chosen: list[int] = []
    remaining = np.ones(len(markers.ids), bool)
    while len(chosen) < MAX_VIEWS and (remaining.any() or len(chosen) < MIN_VIEWS):
        gain = (visible & remaining).sum(1) + 1e-3 * (visible * facing).sum(1)
        gain[chosen] = -1
        chosen.append(int(gain.argmax()))
        remaining &= ~visible[chosen[-1]]
    return [(directions[i], visible[i]) for i in chosen]


def draw_picture(body: Surface, markers: Markers, view: Float, visible: Bool) -> bytes:
    """Draw the body with all tags, and the numbers of visible tags next to them.

    Numbers are red on the anchor.

    Args:
        body: Surface of the body.
        markers: The markers.
        view: Direction (3,) from the body to the viewer.
        visible: Tags that the picture shows (m,).

    Returns:
        The picture as PNG.
    """
    camera_view = looking(view, np.array([0, 0, 1.0] if abs(view[2]) < 0.9 else [0, 1.0, 0]))
    tags = dictionary(markers.dictionary)
    lift = max(0.5, 0.08 * markers.size)  # so that it clears a skin that is not quite flat
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
        shot = scene.shot(camera_view, *(np.array(PICTURE_PX) - 2 * RIM_PX))
    sheet = Sheet(*(np.array(shot.size) + 2 * RIM_PX))
    sheet.paste(shot.image, (RIM_PX, RIM_PX))
    positions = _label_positions(markers, visible, half, camera_view, LABEL_PX[1] / shot.scale)
    for k in np.flatnonzero(visible):
        pixel = np.clip(
            shot.pixel(positions[k][None])[0] + RIM_PX,
            RIM_PX / 2,
            np.array(sheet.size) - RIM_PX / 2,
        )
        label = str(markers.ids[k])
        label_width = extent(label, TEXT, bold=True)[0] + 8
        color = ANCHOR_COLOR if markers.anchor[k] else TAG_COLOR
        sheet.box(
            pixel - [label_width / 2, LABEL_PX[0] + 4], (label_width, 2 * LABEL_PX[0] + 8), color
        )
        sheet.text(pixel, label, TEXT, "white", bold=True)
    return sheet.png()


def _label_positions(
    markers: Markers, visible: Bool, half: float, view: View, room: float
) -> Float:
    """Return where numbers go (m, 3), mm.

    They are below the pieces, or on the side of them that is farthest from other tags. `half` is
    half the side of a piece.
    """
    right, up = view.right, view.up
    sides = np.array([-up, up, right, -right])
    reach = half * np.abs(np.einsum("mjk,sj->msk", markers.axes[:, :, :2], sides)).sum(2) + room
    candidates = markers.centers[:, None] + reach[..., None] * sides
    screen = np.stack([right, up], axis=1)
    tags = (markers.centers @ screen)[visible]
    distance = np.linalg.norm((candidates @ screen)[:, :, None] - tags, axis=3)
    is_same_tag = np.linalg.norm(markers.centers @ screen - tags[:, None], axis=2).T < 1e-9
    distance = np.where(is_same_tag[:, None], np.inf, distance).min(2, initial=np.inf)
    best = np.where(distance[:, 0] > 1.6 * half, 0, distance.argmax(1))
    return np.asarray(candidates[np.arange(len(candidates)), best])


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
    chosen = choose_views(body, markers)
    canvas.setPageSize((width * POINTS_PER_MM, height * POINTS_PER_MM))
    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    y = _draw_heading(canvas, height, f"{markers.device}: where the tags go")
    lines = [
        "Glue each tag where the pictures show it, in the same orientation."
        + (f" Red: on the anchor ({anchor})." if anchor else ""),
        *(f"Note: {n}" for n in notes),
    ]
    for line in lines:
        y = _draw_paragraph(canvas, line, y, width)
    image_width = width - 2 * MARGIN_MM
    for n, (view, visible) in enumerate(chosen):
        image = ImageReader(io.BytesIO(draw_picture(body, markers, view, visible)))
        w, h = image.getSize()
        image_height = image_width * h / w
        if y - image_height - 8 < MARGIN_MM:
            y = _start_page(canvas, width, height)
        _draw_text(canvas, MARGIN_MM, y - 4, f"Picture {n + 1}", 10, bold=True)
        canvas.drawImage(image, MARGIN_MM, y - 6 - image_height, image_width, image_height)
        y -= image_height + 9
    _draw_table(canvas, markers, chosen, width, height, y)
    canvas.showPage()


def _draw_table(
    canvas: Any,
    markers: Markers,
    chosen: Sequence[tuple[Float, Bool]],
    width: float,
    height: float,
    y: float,
) -> None:
    columns = np.array([0.0, 22, 85, 110]) + MARGIN_MM
    headings = ("Number", "Center (x, y, z), mm, rest frame", "Anchor", "Pictures")
    if y - 8 - ROW_MM * (len(markers.ids) + 1) < MARGIN_MM:
        y = _start_page(canvas, width, height)
    rows = [
        (
            str(i),
            format_point(c),
            "yes" if is_on_anchor else "",
            ", ".join(str(n + 1) for n, (_, visible) in enumerate(chosen) if visible[k]) or "-",
        )
        for k, (i, c, is_on_anchor) in enumerate(
            zip(markers.ids, markers.centers, markers.anchor, strict=True)
        )
    ]
    for n, row in enumerate((headings, *rows)):
        if y - ROW_MM < MARGIN_MM:
            y = _start_page(canvas, width, height)
        y -= ROW_MM
        for x, cell in zip(columns, row, strict=True):
            _draw_text(canvas, x, y + 1.5, cell, 9, bold=n == 0)
        canvas.setStrokeGray(0.75)
        canvas.setLineWidth(0.1)
        canvas.line(MARGIN_MM, y, width - MARGIN_MM, y)


def _draw_heading(canvas: Any, height: float, title: str) -> float:
    _draw_text(canvas, MARGIN_MM, height - MARGIN_MM, title, 14, bold=True)
    return height - MARGIN_MM - 4


def _start_page(canvas: Any, width: float, height: float) -> float:
    canvas.showPage()
    canvas.setPageSize((width * POINTS_PER_MM, height * POINTS_PER_MM))
    canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
    return height - MARGIN_MM


def _draw_paragraph(canvas: Any, text: str, y: float, width: float) -> float:
    from reportlab.lib.utils import simpleSplit

    for line in simpleSplit(text, "Helvetica", 9, (width - 2 * MARGIN_MM) * POINTS_PER_MM):
        y -= 4
        _draw_text(canvas, MARGIN_MM, y, line, 9)
    return y - 1


def _draw_text(
    canvas: Any, x: float, y: float, text: str, points: float, bold: bool = False
) -> None:
    canvas.setFillGray(0)
    canvas.setFont("Helvetica-Bold" if bold else "Helvetica", points / POINTS_PER_MM)
    canvas.drawString(x, y, text)
