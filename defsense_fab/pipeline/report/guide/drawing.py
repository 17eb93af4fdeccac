"""A picture of solids with labels beside them: the view holds all of them, no label covers any."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from ....core.arrays import Bool, Float
from ....core.mesh import Surface
from ..pictures.labels import spot
from ..pictures.scene import Scene, Shot, poly
from ..pictures.views import View

_WIDTH, _LEAST, _MOST = 640, 260, 620  # pixels of what is rendered
_COLUMN, _EDGE = 225, 14  # pixels of the labels' columns, and around what is rendered
_FONT, _LINE, _BETWEEN = 24, 29, 9
_INK, _LEADER = "#1b262c", "#52616b"
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
        from PIL import Image

        with Scene() as scene:
            for shape in self.shapes:
                shape(scene)
            shot = scene.shot(self.view, _WIDTH, _MOST)
            named = any(isinstance(at, str) for at, _ in self.labels)
            masks = scene.seen() if named else {}
        width, height = shot.size
        placed = self._placed(shot, masks)
        tall = max(height, _LEAST, *(int(_LINE * (1 + _rows(side))) for side in placed))
        left, right = (_spread(side, height, (tall - height) / 2) for side in placed)
        columns = _COLUMN if self.labels else 0
        key = _LINE + _EDGE if self.legend else 0
        page = Image.new("RGB", (width + 2 * columns, tall + key), "white")
        page.paste(Image.fromarray(shot.image), (columns, (tall - height) // 2))
        _write(page, left, right, columns, width, (tall - height) // 2)
        if self.legend:
            _key(page, self.legend, tall)
        buffer = io.BytesIO()
        page.quantize(_SHADES, dither=Image.Dither.NONE).save(buffer, format="PNG", optimize=True)
        return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()

    def _placed(self, shot: Shot, seen: Mapping[str, Bool]) -> tuple[list[Any], list[Any]]:
        """Labels of the left and the right column, (x and y of the anchor in pixels, text lines),
        those whose places are more to the left in the left one."""
        width, height = shot.size
        spots = []
        for at, text in self.labels:
            if isinstance(at, str):
                found = spot(seen[at])
            else:
                found = tuple(shot.pixel(np.asarray(at, float)[None])[0].tolist())
            if found is not None:
                spots.append((*found, _wrapped(text)))
        sides: tuple[list[Any], list[Any]] = ([], [])
        for label in sorted(spots):
            sides[int(label[0] > width / 2)].append(label)
        # Where one column is full, those nearest to the middle go to the other one.
        for full, other, which in ((0, 1, -1), (1, 0, 0)):
            while sum(len(s[2]) * _LINE + _BETWEEN for s in sides[full]) > max(height, _LEAST):
                sides[other].append(sides[full].pop(which))
        return sides


def _spread(
    side: Sequence[tuple[float, float, list[str]]], height: int, spare: float = 0.0
) -> list[Any]:
    """Rows (middle in pixels, text lines, anchor) beside their places, moved apart where they would
    overlap, into the `spare` room above and below a picture's `height` where they need it."""
    some = sorted(side, key=lambda s: s[1])
    high = [_LINE * len(text) + _BETWEEN for _, _, text in some]
    feet: list[float] = []
    for (_, y, _), tall in zip(some, high, strict=True):
        feet.append(max(feet[-1] if feet else -spare, y - tall / 2) + tall)
    # Pushed beyond the foot, they move up again.
    over = height + spare - _LINE / 2
    for k in range(len(feet) - 1, -1, -1):
        feet[k] = min(feet[k], over)
        over = feet[k] - high[k]
    return [
        (foot - tall / 2, text, (x, y))
        for foot, tall, (x, y, text) in zip(feet, high, some, strict=True)
    ]


def _rows(side: Sequence[Any]) -> float:
    return sum(len(text) + _BETWEEN / _LINE for _, _, text in side)


def _wrapped(text: str) -> list[str]:
    """Lines that fit into a column."""
    font, lines = _font(), [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > _COLUMN - 2 * _EDGE:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _write(page: Any, left: Any, right: Any, column: int, width: int, top: int) -> None:
    from PIL import ImageDraw

    draw, font = ImageDraw.Draw(page), _font()
    for side, rows in ((0, left), (1, right)):
        for y, text, (ax, ay) in rows:
            longest = max(font.getlength(t) for t in text)
            x = column - _EDGE - longest if side == 0 else column + width + _EDGE
            at = y + top
            edge = column - _EDGE + 4 if side == 0 else column + width + _EDGE - 4
            tip = (column + ax, top + ay)
            draw.line([(edge, at), tip], fill="white", width=4)
            draw.line([(edge, at), tip], fill=_LEADER, width=2)
            draw.ellipse([tip[0] - 4, tip[1] - 4, tip[0] + 4, tip[1] + 4], fill=_LEADER,
                         outline="white")  # fmt: skip
            for k, line in enumerate(text):
                draw.text((x, at + (k - len(text) / 2 + 0.5) * _LINE), line, fill=_INK, font=font,
                          anchor="lm")  # fmt: skip


def _key(page: Any, legend: Mapping[str, str], tall: int) -> None:
    """What the colours are, in a row below: each thing as it looks, a thin wire, a thick cord."""
    from PIL import ImageDraw

    draw, font = ImageDraw.Draw(page), _font()
    wide = sum(_ICON + 8 + font.getlength(name) + 22 for name in legend) - 22
    x, y = max(_EDGE, (page.width - wide) / 2), tall + _LINE / 2
    for name, color in legend.items():
        half = next((h for what, h in _HALVES if name.startswith(what)), 8)
        rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
        for row in range(-half, half + 1):  # round: light above the middle, dark at the edges
            light = 1.25 - 1.1 * abs((row + 0.35 * half) / (1.35 * half + 1))
            shade = tuple(min(255, int(c * light + 40 * max(0.0, light - 0.9))) for c in rgb)
            draw.line([(x, y + row), (x + _ICON, y + row)], fill=shade)
        draw.text((x + _ICON + 8, y), name, fill=_INK, font=font, anchor="lm")
        x += _ICON + 8 + font.getlength(name) + 22


def _pale(color: str) -> str:
    """Lighter, so that black cords stand out."""
    rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return "#" + "".join(f"{int(c + 0.5 * (255 - c)):02x}" for c in rgb)


@cache
def _font() -> Any:
    import matplotlib
    from PIL import ImageFont

    path = Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"
    return ImageFont.truetype(str(path), _FONT)
