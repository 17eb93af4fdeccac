"""What is written and drawn around the panels of a picture: text, lines, dots, axes."""

from __future__ import annotations

import base64
import io
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from .views import View

# Colours of parts and cords in pictures, in their order.

COLORS = ("#d1495b", "#00798c", "#edae49", "#66a182", "#8d5a97", "#2e4057", "#e07a5f", "#3d405b")

INK, SOFT = "#1b262c", "#52616b"
#: Sizes of letters in pixels: a picture may be shown at half its size.
TEXT, SMALL = 22, 19
#: Letters and colours of the axes, which also those tell apart who see red and green alike.
AXES = (("x", "#d55e00"), ("y", "#009e73"), ("z", "#0072b2"))
_APART = 13  # pixels between the letters of axes
#: A place or a size: two numbers, pixels.
Place = Any
_FINE = 3  # lines are drawn so much finer, and then smoothed


@cache
def _font(size: int, bold: bool) -> Any:
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


def extent(text: str, size: int = TEXT, bold: bool = False) -> tuple[float, float]:
    """Width and height of a line of text, pixels."""
    return float(_font(size, bold).getlength(text)), 1.25 * size


def shortened(text: str, width: float, size: int = TEXT, bold: bool = False) -> str:
    """The text, or its beginning with three dots where it is wider than `width` pixels."""
    if extent(text, size, bold)[0] <= width:
        return text
    while text and extent(text + "…", size, bold)[0] > width:
        text = text[:-1]
    return text + "…"


class Sheet:
    """A white picture of `width` times `height` pixels; places are pixels from its top left."""

    def __init__(self, width: float, height: float) -> None:
        self._image = Image.new("RGB", (round(width), round(height)), "white")
        self._lines: dict[str, list[tuple[list[tuple[float, float]], float]]] = {}

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self._image.size

    def paste(self, image: Any, at: Place) -> None:
        """An image (h, w, 3) with its top left `at` a place."""
        self._image.paste(Image.fromarray(image), (round(at[0]), round(at[1])))

    def line(self, points: Any, color: str = INK, width: float = 1.5) -> None:
        """Through points (n, 2); drawn before the text, whenever that is written."""
        path = [(float(x), float(y)) for x, y in points]
        self._lines.setdefault(color, []).append((path, width))

    def dot(self, at: Place, color: str = INK, radius: float = 4.0) -> None:
        """A round dot."""
        angles = np.linspace(0, 2 * np.pi, 12)
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self.line(np.asarray(at) + ring * radius / 2, color, radius)

    def text(
        self,
        at: Place,
        text: str,
        size: int = TEXT,
        color: str = INK,
        anchor: str = "mm",
        bold: bool = False,
    ) -> None:
        """A line of text; `anchor` as Pillow has it: l, m or r across, t, m or b up."""
        self._smooth()
        draw = ImageDraw.Draw(self._image)
        draw.text(
            (float(at[0]), float(at[1])), text, fill=color, font=_font(size, bold), anchor=anchor
        )

    def box(self, at: Place, size: Place, color: str) -> None:
        """A filled rectangle with its top left `at` a place."""
        (x, y), (w, h) = at, size
        ImageDraw.Draw(self._image).rectangle((x, y, x + w - 1, y + h - 1), fill=color)

    def axes(self, view: View, corner: Place, size: float = 58.0) -> None:
        """The axes of the rest frame in a square of `size` pixels with its top left at `corner`; of
        one that points at the eye or away from it only the letter is drawn, at its foot."""
        ways = view.flat(np.eye(3)) * [1, -1]
        low = np.minimum(ways.min(0), 0)
        span = float(np.maximum(np.ptp(np.vstack([ways, [0, 0]]), axis=0).max(), 1e-9))
        length = (size - 32) / span
        foot = np.asarray(corner, float) + 16 - low * length
        letters: list[Any] = []
        away = ways.sum(0)  # from the foot, where the others are
        for (letter, color), way in zip(AXES, ways, strict=True):
            tip = foot + length * way
            seen = float(np.linalg.norm(way))
            if seen < 0.15:
                self.dot(foot, color, 4)
                place = foot - 13 * away / max(float(np.linalg.norm(away)), 1e-9)
            else:
                self.line([foot, tip], color, 3)
                place = tip + 9 * way / seen
            while any(np.hypot(*(place - other)) < _APART for other in letters):
                place = place + (way if seen > 1e-6 else away) / max(seen, 1e-6)
            letters.append(place)
            self.text(place, letter, 17, color, bold=True)

    def png(self, shades: int | None = None) -> bytes:
        """The picture as a PNG file, of so many colours, which makes it small, or of all."""
        self._smooth()
        buffer = io.BytesIO()
        if shades is None:
            self._image.save(buffer, format="PNG", compress_level=6)
        else:
            few = self._image.quantize(shades, dither=Image.Dither.NONE)
            few.save(buffer, format="PNG", optimize=True)
        return buffer.getvalue()

    def uri(self, shades: int | None = None) -> str:
        """The same as a data URI."""
        return "data:image/png;base64," + base64.b64encode(self.png(shades)).decode("ascii")

    def _smooth(self) -> None:
        """Draw the lines that wait: finer than the picture, then made smaller, so that they are
        smooth."""
        for color, lines in self._lines.items():
            points = np.concatenate([np.array(path) for path, _ in lines])
            edge = max(width for _, width in lines) + 2
            low = np.floor(points.min(0) - edge).astype(int)
            size = np.ceil(points.max(0) + edge).astype(int) - low
            mask = Image.new("L", tuple(_FINE * size))
            draw = ImageDraw.Draw(mask)
            for path, width in lines:
                fine = [tuple(_FINE * (np.array(p) - low)) for p in path]
                draw.line(fine, fill=255, width=max(1, round(_FINE * width)), joint="curve")
            mask = mask.resize(tuple(size), Image.Resampling.BOX)
            self._image.paste(Image.new("RGB", tuple(size), color), tuple(low), mask)
        self._lines.clear()
