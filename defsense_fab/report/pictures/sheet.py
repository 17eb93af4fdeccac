"""Write and draw around the panels of a picture: text, lines, dots, axes."""

from __future__ import annotations

import base64
import io
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from .views import View

#: Colors of parts and cords, in their order.
COLORS = ("#d1495b", "#00798c", "#edae49", "#66a182", "#8d5a97", "#2e4057", "#e07a5f", "#3d405b")

INK, SOFT = "#1b262c", "#52616b"
#: Font sizes in pixels: pages may show a picture at half its size.
TEXT, SMALL = 22, 19
#: Letters and colors of the axes; people with red-green blindness can distinguish them.
AXES = (("x", "#d55e00"), ("y", "#009e73"), ("z", "#0072b2"))
_MIN_LETTER_DISTANCE_PX = 13
#: A place or a size: two numbers, pixels.
Place = Any
_SUPERSAMPLING = 3  # lines are drawn at this multiple of the resolution, then reduced


@cache
def _font(size: int, bold: bool) -> Any:
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


def extent(text: str, size: int = TEXT, bold: bool = False) -> tuple[float, float]:
    """Return width and height of a line of text, pixels."""
    return float(_font(size, bold).getlength(text)), 1.25 * size


def shortened(text: str, width: float, size: int = TEXT, bold: bool = False) -> str:
    """Return a text, cut off with an ellipsis if it is wider than `width` pixels."""
    if extent(text, size, bold)[0] <= width:
        return text
    while text and extent(text + "…", size, bold)[0] > width:
        text = text[:-1]
    return text + "…"


class Sheet:
    """A white picture to draw on; places are pixels from its top left.

    Args:
        width: Width, pixels.
        height: Height, pixels.
    """

    def __init__(self, width: float, height: float) -> None:
        self._image = Image.new("RGB", (round(width), round(height)), "white")
        self._lines: dict[str, list[tuple[list[tuple[float, float]], float]]] = {}

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self._image.size

    def paste(self, image: Any, at: Place) -> None:
        """Paste an image (h, w, 3) with its top left at a place."""
        self._image.paste(Image.fromarray(image), (round(at[0]), round(at[1])))

    def line(self, points: Any, color: str = INK, width: float = 1.5) -> None:
        """Draw a line through points (n, 2); texts that are written later cover it."""
        path = [(float(x), float(y)) for x, y in points]
        self._lines.setdefault(color, []).append((path, width))

    def dot(self, at: Place, color: str = INK, radius: float = 4.0) -> None:
        """Draw a round dot."""
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
        """Write a line of text; `anchor` is Pillow's (l, m or r across; t, m or b upwards)."""
        self._smooth()
        draw = ImageDraw.Draw(self._image)
        draw.text(
            (float(at[0]), float(at[1])), text, fill=color, font=_font(size, bold), anchor=anchor
        )

    def box(self, at: Place, size: Place, color: str) -> None:
        """Fill a rectangle with its top left at a place."""
        (x, y), (w, h) = at, size
        ImageDraw.Draw(self._image).rectangle((x, y, x + w - 1, y + h - 1), fill=color)

    def axes(self, view: View, corner: Place, size: float = 58.0) -> None:
        """Draw the axes of the rest frame, as seen in a view.

        Of an axis that points towards the eye or away from it, only the letter is drawn.

        Args:
            view: The view.
            corner: Top left of the square that holds the axes, pixels.
            size: Width of the square, pixels.
        """
        directions = view.flat(np.eye(3)) * [1, -1]
        low = np.minimum(directions.min(0), 0)
        span = float(np.maximum(np.ptp(np.vstack([directions, [0, 0]]), axis=0).max(), 1e-9))
        length = (size - 32) / span
        foot = np.asarray(corner, float) + 16 - low * length
        letters: list[Any] = []
        toward_axes = directions.sum(0)  # from the foot
        for (letter, color), direction in zip(AXES, directions, strict=True):
            tip = foot + length * direction
            visible_length = float(np.linalg.norm(direction))
            if visible_length < 0.15:
                self.dot(foot, color, 4)
                position = foot - 13 * toward_axes / max(float(np.linalg.norm(toward_axes)), 1e-9)
            else:
                self.line([foot, tip], color, 3)
                position = tip + 9 * direction / visible_length
            while any(np.hypot(*(position - other)) < _MIN_LETTER_DISTANCE_PX for other in letters):
                position = position + (direction if visible_length > 1e-6 else toward_axes) / max(
                    visible_length, 1e-6
                )
            letters.append(position)
            self.text(position, letter, 17, color, bold=True)

    def png(self, shades: int | None = None) -> bytes:
        """Return the picture as a PNG file, with at most `shades` colors, which makes it small."""
        self._smooth()
        buffer = io.BytesIO()
        if shades is None:
            self._image.save(buffer, format="PNG", compress_level=6)
        else:
            reduced = self._image.quantize(shades, dither=Image.Dither.NONE)
            reduced.save(buffer, format="PNG", optimize=True)
        return buffer.getvalue()

    def uri(self, shades: int | None = None) -> str:
        """Return the picture as a PNG data URI, with at most `shades` colors."""
        return "data:image/png;base64," + base64.b64encode(self.png(shades)).decode("ascii")

    def _smooth(self) -> None:
        """Draw the waiting lines at a higher resolution, and reduce them to smooth them."""
        for color, lines in self._lines.items():
            points = np.concatenate([np.array(path) for path, _ in lines])
            edge = max(width for _, width in lines) + 2
            low = np.floor(points.min(0) - edge).astype(int)
            size = np.ceil(points.max(0) + edge).astype(int) - low
            mask = Image.new("L", tuple(_SUPERSAMPLING * size))
            draw = ImageDraw.Draw(mask)
            for path, width in lines:
                scaled_path = [tuple(_SUPERSAMPLING * (np.array(p) - low)) for p in path]
                draw.line(
                    scaled_path,
                    fill=255,
                    width=max(1, round(_SUPERSAMPLING * width)),
                    joint="curve",
                )
            mask = mask.resize(tuple(size), Image.Resampling.BOX)
            self._image.paste(Image.new("RGB", tuple(size), color), tuple(low), mask)
        self._lines.clear()
