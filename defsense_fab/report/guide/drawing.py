"""A picture of solids with labels beside them: the view holds all of them, no label covers any."""

from __future__ import annotations

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

_WIDTH, _LEAST, _MOST = 640, 260, 620  # pixels of what is rendered
_COLUMN, _EDGE, _APART = 240, 14, 6  # pixels of columns, at edges, between a line and its label
_FONT, _LINE, _BETWEEN = 24, 29, 9
_ICON, _HALVES = 36, (("wire", 3), ("cord", 5), ("ferrule", 7))  # pixels: long, half as high
_SHADES = 160  # colours of the file


@dataclass
class Drawing:
    """Collects what a picture shows; `png` makes it. With a `focus`, a point (3,) and a distance in
    mm, it shows what lies so near to it, instead of all."""

    view: View
    focus: tuple[Float, float] | None = None
    shapes: list[Callable[[Scene], None]] = field(default_factory=list)
    labels: list[tuple[Float | str, str]] = field(default_factory=list)
    legend: dict[str, str] = field(default_factory=dict)

    def part(
        self, surface: Surface, color: str, shift: Float | None = None, name: str = ""
    ) -> None:
        """A part with its edges, moved by `shift` (3,) mm; with a `name` it can be labelled where
        it is seen."""
        moved = surface if shift is None else Surface(surface.vertices + shift, surface.faces)
        if self.focus is None:
            self.shapes.append(lambda scene: scene.solid(moved, _pale(color), name=name))
            return
        at, far = self.focus
        flat = self.view.flat(moved.vertices - at)
        near = at + np.clip(flat, -far, far) @ np.stack([self.view.right, self.view.up])
        self.shapes.append(
            lambda scene: scene.mesh(poly(moved), near, color=_pale(color), split_sharp_edges=True)
        )

    def rod(self, line: Float, radius: float, color: str) -> None:
        """A round rod along a line (p, 3) mm."""
        self.shapes.append(lambda scene: scene.tube(line, color, radius))

    def cylinder(self, middle: Float, along: Float, radius: float, long: float, color: str) -> None:
        """A cylinder around its middle (3,) mm."""
        self.shapes.append(lambda scene: scene.cylinder(middle, along, 2 * radius, long, color))

    def ball(self, middle: Float, radius: float, color: str) -> None:
        """A drop, say of glue."""
        self._mesh(pv.Sphere(radius=radius, center=middle), color)

    def arrow(self, start: Float, tip: Float, color: str) -> None:
        """A thick arrow from `start` to `tip` (3,) mm."""
        long = float(np.linalg.norm(tip - start))
        thick = min(0.12, 1.6 / max(long, 1.0))
        mesh = pv.Arrow(
            start=start, direction=tip - start, scale=long, shaft_radius=thick,
            tip_radius=2.6 * thick, tip_length=min(0.45, 7 * thick),
        )  # fmt: skip
        self._mesh(mesh, color)

    def _mesh(self, mesh: Any, color: str) -> None:
        points = np.asarray(mesh.points, float)
        self.shapes.append(lambda scene: scene.mesh(mesh, points, color=color))

    def label(self, at: Float | str, text: str) -> None:
        """A text in a column beside the picture, with a line to `at`: a place (3,) mm, or a part's
        name: to where most of it is seen."""
        self.labels.append((at, text))

    def png(self) -> str:
        """The picture as a data URI."""
        with Scene() as scene:
            for shape in self.shapes:
                shape(scene)
            shot = scene.shot(self.view, _WIDTH, _MOST)
            named = any(isinstance(at, str) for at, _ in self.labels)
            masks = scene.seen() if named else {}
        width, height = shot.size
        anchors, texts = self._seen(shot, masks)
        high = np.array([_LINE * len(text) + _BETWEEN for text in texts])
        left = places(anchors, shot.size, high).left
        tall = max(height, _LEAST, *(int(high[left == side].sum()) for side in (True, False)))
        columns = _COLUMN if self.labels else 0
        page = Sheet(width + 2 * columns, tall + (_LINE + _EDGE if self.legend else 0))
        corner = np.array([columns, (tall - height) // 2])
        page.paste(shot.image, corner)
        placed = places(anchors, shot.size, high, (-corner[1], tall - corner[1]))
        for text, at, end, is_left in zip(texts, anchors, placed.ends, placed.left, strict=True):
            _write(page, text, at + corner, end + corner, is_left)
        if self.legend:
            _key(page, self.legend, tall)
        return page.uri(_SHADES)

    def _seen(self, shot: Shot, seen: Mapping[str, Bool]) -> tuple[Float, list[list[str]]]:
        """Where (n, 2) labels point to in the picture, pixels, and their lines of text."""
        anchors, texts = [], []
        for at, text in self.labels:
            if isinstance(at, str):
                found = spot(seen[at])
            else:
                found = tuple(shot.pixel(np.asarray(at, float)[None])[0].tolist())
            if found is not None:
                anchors.append(found)
                texts.append(_wrapped(text))
        return np.array(anchors, float).reshape(-1, 2), texts


def _wrapped(text: str) -> list[str]:
    """Lines that fit into a column."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and extent(longer, _FONT)[0] > _COLUMN - GAP - _APART - _EDGE:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _write(page: Sheet, text: Sequence[str], at: Float, end: Float, left: bool) -> None:
    """A label's lines, and the line from its `end` (2,) to what it names `at` (2,), pixels."""
    page.line([end, at], "white", 4.5)
    page.line([end, at], SOFT, 2)
    page.dot(at, "white", 6)
    page.dot(at, SOFT, 4)
    longest = max(extent(line, _FONT)[0] for line in text)
    x = end[0] - _APART - longest if left else end[0] + _APART
    for k, line in enumerate(text):
        page.text((x, end[1] + (k - len(text) / 2 + 0.5) * _LINE), line, _FONT, INK, "lm")


def _key(page: Sheet, legend: Mapping[str, str], tall: int) -> None:
    """What the colours are, in a row below: each thing as it looks, a thin wire, a thick cord."""
    wide = sum(_ICON + 8 + extent(name, _FONT)[0] + 22 for name in legend) - 22
    x, y = max(_EDGE, (page.size[0] - wide) / 2), tall + _LINE / 2
    for name, color in legend.items():
        half = next((h for what, h in _HALVES if name.startswith(what)), 8)
        rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
        for row in range(-half, half + 1):  # round: light above the middle, dark at the edges
            light = 1.25 - 1.1 * abs((row + 0.35 * half) / (1.35 * half + 1))
            shade = [min(255, int(c * light + 40 * max(0.0, light - 0.9))) for c in rgb]
            page.box((x, y + row), (_ICON, 1), "#" + "".join(f"{c:02x}" for c in shade))
        page.text((x + _ICON + 8, y), name, _FONT, INK, "lm")
        x += _ICON + 8 + extent(name, _FONT)[0] + 22


def _pale(color: str) -> str:
    """Lighter, so that black cords stand out."""
    rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return "#" + "".join(f"{int(c + 0.5 * (255 - c)):02x}" for c in rgb)
