"""Draw solids with labels next to them, so that the view holds all solids and covers no label."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyvista as pv

from ...core.arrays import Bool, Float
from ...core.mesh import Surface
from ..pictures.labels import GAP, places, spot
from ..pictures.scene import Scene, Shot, poly
from ..pictures.sheet import INK, SOFT, Sheet, extent
from ..pictures.views import View

_WIDTH_PX, _MIN_HEIGHT_PX, _MAX_HEIGHT_PX = 640, 260, 620  # of the rendered solids
COLUMN_WIDTH_PX = 240  # of the labels' columns
LINE_HEIGHT_PX = 29
_EDGE_MARGIN_PX = 14
_LABEL_GAP_PX = 6  # between a label and the end of its line
_LABEL_SPACING_PX = 9
_FONT_PX = 24
_ICON_WIDTH_PX = 36  # of the legend
_ICON_HALF_HEIGHT_PX = {"wire": 3, "cord": 5, "ferrule": 7}  # by the legend's entry
_DEFAULT_ICON_HALF_HEIGHT_PX = 8
_PALETTE_SIZE = 160  # colors of the PNG file


@dataclass
class Drawing:
    """Collects the content of a picture, which `png` draws.

    Attributes:
        view: View of the picture.
        focus: A point (3,) mm and a distance in mm; the picture shows only things closer to the
            point. None shows everything.
        shapes: Functions that add the shapes to a scene.
        labels: Anchor and text of each label; an anchor is a place (3,) mm or the name of a part.
        legend: Colors by the names of things.
    """

    view: View
    focus: tuple[Float, float] | None = None
    shapes: list[Callable[[Scene], None]] = field(default_factory=list)
    labels: list[tuple[Float | str, str]] = field(default_factory=list)
    legend: dict[str, str] = field(default_factory=dict)

    def part(
        self, surface: Surface, color: str, shift: Float | None = None, name: str = ""
    ) -> None:
        """Add a part with its edges.

        Args:
            surface: Surface of the part.
            color: Color of the part; it is drawn lighter, so that black cords stand out.
            shift: Displacement (3,), mm.
            name: Name by which labels can point at the part.
        """
        moved = surface if shift is None else Surface(surface.vertices + shift, surface.faces)
        if self.focus is None:
            self.shapes.append(lambda scene: scene.solid(moved, _lighten(color), name=name))
            return
        center, radius = self.focus
        flat = self.view.flat(moved.vertices - center)
        clipped = center + np.clip(flat, -radius, radius) @ np.stack(
            [self.view.right, self.view.up]
        )
        self.shapes.append(
            lambda scene: scene.mesh(
                poly(moved), clipped, color=_lighten(color), split_sharp_edges=True
            )
        )

    def rod(self, line: Float, radius: float, color: str) -> None:
        """Add a round rod along a line (p, 3), mm."""
        self.shapes.append(lambda scene: scene.tube(line, color, radius))

    def cylinder(
        self, middle: Float, direction: Float, radius: float, length: float, color: str
    ) -> None:
        """Add a cylinder with its middle at a place (3,); lengths in mm."""
        self.shapes.append(
            lambda scene: scene.cylinder(middle, direction, 2 * radius, length, color)
        )

    def ball(self, middle: Float, radius: float, color: str) -> None:
        """Add a ball, such as a drop of glue; lengths in mm."""
        self._mesh(pv.Sphere(radius=radius, center=middle), color)

    def arrow(self, start: Float, tip: Float, color: str) -> None:
        """Add a thick arrow between two places (3,), mm."""
        length = float(np.linalg.norm(tip - start))
        thickness = min(0.12, 1.6 / max(length, 1.0))
        mesh = pv.Arrow(
            start=start,
            direction=tip - start,
            scale=length,
            shaft_radius=thickness,
            tip_radius=2.6 * thickness,
            tip_length=min(0.45, 7 * thickness),
        )
        self._mesh(mesh, color)

    def _mesh(self, mesh: Any, color: str) -> None:
        points = np.asarray(mesh.points, float)
        self.shapes.append(lambda scene: scene.mesh(mesh, points, color=color))

    def label(self, at: Float | str, text: str) -> None:
        """Add a label in a column next to the picture, with a line to what it names.

        Args:
            at: A place (3,) in mm, or the name of a part: the line then points at its visible area.
            text: Text of the label.
        """
        self.labels.append((at, text))

    def png(self) -> str:
        """Draw the picture and return it as a PNG data URI."""
        with Scene() as scene:
            for shape in self.shapes:
                shape(scene)
            shot = scene.shot(self.view, _WIDTH_PX, _MAX_HEIGHT_PX)
            has_part_labels = any(isinstance(at, str) for at, _ in self.labels)
            masks = scene.visible_areas() if has_part_labels else {}
        width, height = shot.size
        anchors, texts = self._locate_labels(shot, masks)
        label_heights = np.array([LINE_HEIGHT_PX * len(text) + _LABEL_SPACING_PX for text in texts])
        left = places(anchors, shot.size, label_heights).left
        height_px = max(
            height,
            _MIN_HEIGHT_PX,
            *(int(label_heights[left == side].sum()) for side in (True, False)),
        )
        columns = COLUMN_WIDTH_PX if self.labels else 0
        page = Sheet(
            width + 2 * columns,
            height_px + (LINE_HEIGHT_PX + _EDGE_MARGIN_PX if self.legend else 0),
        )
        corner = np.array([columns, (height_px - height) // 2])
        page.paste(shot.image, corner)
        placed = places(anchors, shot.size, label_heights, (-corner[1], height_px - corner[1]))
        for text, at, end, is_left in zip(texts, anchors, placed.ends, placed.left, strict=True):
            _write_label(page, text, at + corner, end + corner, is_left)
        if self.legend:
            _write_legend(page, self.legend, height_px)
        return page.uri(_PALETTE_SIZE)

    def _locate_labels(
        self, shot: Shot, masks: Mapping[str, Bool]
    ) -> tuple[Float, list[list[str]]]:
        """Return the pixels (n, 2) of the visible labels' anchors, and the lines of their texts."""
        anchors, texts = [], []
        for at, text in self.labels:
            if isinstance(at, str):
                anchor = spot(masks[at])
            else:
                anchor = tuple(shot.pixel(np.asarray(at, float)[None])[0].tolist())
            if anchor is not None:
                anchors.append(anchor)
                texts.append(_wrap_text(text))
        return np.array(anchors, float).reshape(-1, 2), texts


def _wrap_text(text: str) -> list[str]:
    """Break a text into lines that fit into a column."""
    max_width = COLUMN_WIDTH_PX - GAP - _LABEL_GAP_PX - _EDGE_MARGIN_PX
    lines = [""]
    for piece in re.findall(r" ?[^ -]*-?", text):  # lines also break after hyphens
        longer = (lines[-1] + piece).lstrip()
        if lines[-1] and extent(longer, _FONT_PX)[0] > max_width:
            lines.append(piece.lstrip())
        else:
            lines[-1] = longer
    return lines


def _write_label(page: Sheet, text: Sequence[str], at: Float, end: Float, is_left: bool) -> None:
    """Write a label, and draw the line from its `end` (2,) to its anchor `at` (2,), pixels."""
    page.line([end, at], "white", 4.5)
    page.line([end, at], SOFT, 2)
    page.dot(at, "white", 6)
    page.dot(at, SOFT, 4)
    longest = max(extent(line, _FONT_PX)[0] for line in text)
    x = end[0] - _LABEL_GAP_PX - longest if is_left else end[0] + _LABEL_GAP_PX
    for k, line in enumerate(text):
        page.text(
            (x, end[1] + (k - len(text) / 2 + 0.5) * LINE_HEIGHT_PX), line, _FONT_PX, INK, "lm"
        )


def _write_legend(page: Sheet, legend: Mapping[str, str], top: int) -> None:
    """Draw the legend below the picture; each icon is as thick as its thing is."""
    width = sum(_ICON_WIDTH_PX + 8 + extent(name, _FONT_PX)[0] + 22 for name in legend) - 22
    x, y = max(_EDGE_MARGIN_PX, (page.size[0] - width) / 2), top + LINE_HEIGHT_PX / 2
    for name, color in legend.items():
        half_height = _ICON_HALF_HEIGHT_PX.get(name, _DEFAULT_ICON_HALF_HEIGHT_PX)
        rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
        # The icon looks round: light above its middle, dark at its edges.
        for row in range(-half_height, half_height + 1):
            light = 1.25 - 1.1 * abs((row + 0.35 * half_height) / (1.35 * half_height + 1))
            shade = [min(255, int(c * light + 40 * max(0.0, light - 0.9))) for c in rgb]
            page.box((x, y + row), (_ICON_WIDTH_PX, 1), "#" + "".join(f"{c:02x}" for c in shade))
        page.text((x + _ICON_WIDTH_PX + 8, y), name, _FONT_PX, INK, "lm")
        x += _ICON_WIDTH_PX + 8 + extent(name, _FONT_PX)[0] + 22


def _lighten(color: str) -> str:
    """Return a lighter color."""
    rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return "#" + "".join(f"{int(c + 0.5 * (255 - c)):02x}" for c in rgb)
