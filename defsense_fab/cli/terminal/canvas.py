"""Draw dots in a terminal, two by four per character, as braille patterns."""

from __future__ import annotations

from collections.abc import Iterable

from rich.style import Style
from rich.text import Text

#: Bits of the dots of a braille pattern, by row and column (Unicode 15, 2800-28FF).
_BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))


class Canvas:
    """Canvas of characters with two by four dots each.

    Args:
        width: Number of characters per row.
        height: Number of rows.
        x: Limits of x, left and right.
        y: Limits of y, bottom and top.
    """

    def __init__(
        self, width: int, height: int, x: tuple[float, float], y: tuple[float, float]
    ) -> None:
        self._width, self._height = width, height
        (self._left, self._right), (self._low, self._high) = x, y
        self._dots = [[0] * width for _ in range(height)]
        self._styles: list[list[str | None]] = [[None] * width for _ in range(height)]

    def dots(self, points: Iterable[tuple[float, float]], style: str | None = None) -> None:
        """Draw points (x, y); points outside of the limits are ignored."""
        for x, y in points:
            i = round((x - self._left) / (self._right - self._left) * (2 * self._width - 1))
            j = round((self._high - y) / (self._high - self._low) * (4 * self._height - 1))
            if 0 <= i < 2 * self._width and 0 <= j < 4 * self._height:
                self._dots[j // 4][i // 2] |= _BITS[j % 4][i % 2]
                if style is not None:
                    self._styles[j // 4][i // 2] = style

    def line(
        self, start: tuple[float, float], end: tuple[float, float], style: str | None = None
    ) -> None:
        """Draw a straight line."""
        n = 2 * max(self._width * 2, self._height * 4)
        self.dots(
            (
                (start[0] + (end[0] - start[0]) * k / n, start[1] + (end[1] - start[1]) * k / n)
                for k in range(n + 1)
            ),
            style,
        )

    def lines(self) -> list[Text]:
        """Return the rows, from the top."""
        out = []
        for dots, styles in zip(self._dots, self._styles, strict=True):
            row = Text()
            for bits, style in zip(dots, styles, strict=True):
                row.append(chr(0x2800 + bits) if bits else " ", Style.parse(style or ""))
            out.append(row)
        return out
