"""Draw color bars with round numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .sheet import INK, SMALL, Sheet, extent

#: Color maps with an even lightness, so that their order is also visible without color.
STRAIN, ERROR = "viridis", "magma_r"

#: Height of a bar with its title and numbers, pixels.
HEIGHT = 104.0
_BAR_HEIGHT_PX = 20
_MAX_STEPS = 5


@dataclass(frozen=True)
class Scale:
    """A scale of colors.

    Attributes:
        colors: Name of a matplotlib color map.
        title: Title of the scale.
        top: Value of the last color; the first one is 0.
        step: Distance of the numbers.
        beyond: Whether there are values above `top`.
    """

    colors: str
    title: str
    top: float
    step: float
    beyond: bool = False


def scale(colors: str, title: str, largest: float, beyond: bool = False) -> Scale:
    """Return a scale with at most five round steps whose end is not below a value.

    Args:
        colors: Name of a matplotlib color map.
        title: Title of the scale.
        largest: Largest value.
        beyond: Whether there are values above `largest`.
    """
    if not largest > 0:
        return Scale(colors, title, 1.0, 0.5, beyond)
    power = 10.0 ** np.floor(np.log10(largest / _MAX_STEPS))
    steps = (s * power for s in (1, 2, 2.5, 5, 10, 20))
    step = next(s for s in steps if np.ceil(largest / s - 1e-9) <= _MAX_STEPS)
    return Scale(colors, title, float(np.ceil(largest / step - 1e-9) * step), float(step), beyond)


def draw(sheet: Sheet, bar_scale: Scale, x: float, y: float, width: float) -> None:
    """Draw a color bar with its title above and its numbers below.

    Args:
        sheet: The sheet.
        bar_scale: The scale.
        x: Left edge, pixels.
        y: Upper edge, pixels.
        width: Width of the bar, pixels.
    """
    import matplotlib

    length = round(width)
    colors = matplotlib.colormaps[bar_scale.colors](np.linspace(0, 1, length))[:, :3]
    bar = np.repeat((255 * colors).round().astype(np.uint8)[None], _BAR_HEIGHT_PX, axis=0)
    top = y + 1.6 * SMALL
    sheet.text((x + width / 2, y + SMALL * 0.8), bar_scale.title, SMALL)
    sheet.paste(bar, (x, top))
    count = round(bar_scale.top / bar_scale.step)
    widest = extent(f"≥ {bar_scale.top - bar_scale.step:.6g}", SMALL)[0]
    every = 1 if width / count > 1.1 * widest else 2  # so that numbers do not touch
    for k in range(count + 1):
        at = x + width * k / count
        text = f"{k * bar_scale.step:.6g}"
        if k == count and bar_scale.beyond:
            text = f"≥ {text}"
        sheet.line([(at, top + _BAR_HEIGHT_PX), (at, top + _BAR_HEIGHT_PX + 6)], INK, 1.2)
        if k % every == 0 or (k == count and every == 1):
            sheet.text((at, top + _BAR_HEIGHT_PX + 8 + SMALL / 2), text, SMALL)
