"""A scale of colours with round numbers, below what it explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .sheet import INK, SMALL, Sheet, extent

#: Scales whose lightness rises or falls evenly, so that those who tell few colours apart, and
#: printers without colour, show their order too.
STRAIN, ERROR = "viridis", "magma_r"

#: Pixels that a bar with its title and numbers takes.
HEIGHT = 104.0
_THICK, _MOST_STEPS = 20, 5


@dataclass(frozen=True)
class Scale:
    """Colours from 0 to `top` in steps of `step`; whether there are values `beyond`."""

    colors: str
    title: str
    top: float
    step: float
    beyond: bool = False


def scale(colors: str, title: str, largest: float, beyond: bool = False) -> Scale:
    """A scale to a round number that is not below `largest`, in at most five round steps."""
    if not largest > 0:
        return Scale(colors, title, 1.0, 0.5, beyond)
    power = 10.0 ** np.floor(np.log10(largest / _MOST_STEPS))
    steps = (s * power for s in (1, 2, 2.5, 5, 10, 20))
    step = next(s for s in steps if np.ceil(largest / s - 1e-9) <= _MOST_STEPS)
    return Scale(colors, title, float(np.ceil(largest / step - 1e-9) * step), float(step), beyond)


def draw(sheet: Sheet, one: Scale, x: float, y: float, width: float) -> None:
    """The bar with its title above and its numbers below, from `x` to `x + width` pixels."""
    import matplotlib

    length = round(width)
    colors = matplotlib.colormaps[one.colors](np.linspace(0, 1, length))[:, :3]
    bar = np.repeat((255 * colors).round().astype(np.uint8)[None], _THICK, axis=0)
    top = y + 1.6 * SMALL
    sheet.text((x + width / 2, y + SMALL * 0.8), one.title, SMALL)
    sheet.paste(bar, (x, top))
    count = round(one.top / one.step)
    widest = extent(f"≥ {one.top - one.step:.6g}", SMALL)[0]
    every = 1 if width / count > 1.1 * widest else 2  # numbers that do not touch
    for k in range(count + 1):
        at = x + width * k / count
        words = f"{k * one.step:.6g}"
        if k == count and one.beyond:
            words = f"≥ {words}"
        sheet.line([(at, top + _THICK), (at, top + _THICK + 6)], INK, 1.2)
        if k % every == 0 or (k == count and every == 1):
            sheet.text((at, top + _THICK + 8 + SMALL / 2), words, SMALL)
