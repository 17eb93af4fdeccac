"""The bar that says which number a colour stands for."""

from __future__ import annotations

import html

import numpy as np

from .color_maps import Scale

_WIDTH, _HEIGHT, _LEFT, _BAR = 280, 44, 24, 18
_STEPS = 64
_TICKS = 5


def color_bar(scale: Scale, title: str, unit: str, note: str) -> str:
    """HTML: a title, the colours with numbers in a `unit` (may be empty) below, a `note`. Words
    have the page's own colour, light or dark."""
    width = _WIDTH - 2 * _LEFT
    step = width / _STEPS
    middles = scale.low + (np.arange(_STEPS) + 0.5) / _STEPS * (scale.high - scale.low)
    boxes = "".join(
        f'<rect x="{_LEFT + k * step:.2f}" y="2" width="{step + 0.4:.2f}" height="{_BAR}"'
        f' fill="rgb({r},{g},{b})"/>'
        for k, (r, g, b) in enumerate(np.rint(255 * scale.colors(middles)).astype(int).tolist())
    )
    ticks = "".join(
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{_BAR + 2}" y2="{_BAR + 7}" stroke="currentColor"/>'
        f'<text x="{x:.1f}" y="{_BAR + 20}" text-anchor="middle">{told}</text>'
        for x, told in zip(
            np.linspace(_LEFT, _LEFT + width, _TICKS), tick_words(scale), strict=True
        )
    )
    unit_told = f" ({html.escape(unit)})" if unit else ""
    return (
        '<div style="padding:0 0.8em;font-size:0.85em">'
        f"<div><b>{html.escape(title)}</b>{unit_told}</div>"
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="100%" role="img"'
        f' aria-label="{html.escape(title)}" font-size="11" fill="currentColor">'
        f"{boxes}{ticks}</svg>"
        f'<div style="opacity:0.8">{html.escape(note)}</div></div>'
    )


def tick_words(scale: Scale) -> list[str]:
    """The numbers under the bar, evenly from end to end."""
    values = np.linspace(scale.low, scale.high, _TICKS)
    return [f"{value + 0.0:.3g}".replace("-", "\u2212") for value in values.tolist()]
