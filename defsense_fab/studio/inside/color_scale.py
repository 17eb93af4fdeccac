"""The bar that says which number a colour stands for."""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

# Colours of numbers, told apart by colour-blind people, in light and dark.

#: Blue below, orange above (ColorBrewer's RdBu and PuOr); cividis; viridis.
_DIVERGING = (
    (5, 48, 97), (33, 102, 172), (67, 147, 195), (146, 197, 222), (209, 229, 240), (220, 220, 220),
    (254, 224, 182), (253, 184, 99), (224, 130, 20), (179, 88, 6), (127, 59, 8),
)  # fmt: skip
_CIVIDIS = (
    (0, 34, 78), (18, 53, 112), (59, 73, 108), (87, 93, 109), (112, 113, 115), (138, 134, 120),
    (165, 156, 116), (195, 179, 105), (225, 204, 85), (254, 232, 56),
)  # fmt: skip
_VIRIDIS = (
    (68, 1, 84), (72, 40, 120), (62, 74, 137), (49, 104, 142), (38, 130, 142), (31, 158, 137),
    (53, 183, 121), (109, 205, 89), (180, 222, 44), (253, 231, 37),
)  # fmt: skip
_UNKNOWN = (150, 150, 150)
#: Differences by less than this share are none.
_ALIKE = 0.03
#: Ends of ranges, times a power of ten: their quarters are short numbers.
_ROUND = (1.0, 1.2, 1.6, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0)


@dataclass(frozen=True)
class Scale:
    """Colours of numbers from `low` to `high`; those beyond have the colours of the ends, and those
    that are not known (NaN) are grey."""

    low: float
    high: float
    anchors: tuple[tuple[int, int, int], ...]

    @classmethod
    def about_zero(cls, reach: float) -> Scale:
        """Symmetric; `reach` is rounded up."""
        end = rounded_up(reach)
        return cls(-end, end, _DIVERGING)

    @classmethod
    def spread(cls, reach: float) -> Scale:
        """From 0 for variances."""
        return cls(0.0, rounded_up(reach), _CIVIDIS)

    @classmethod
    def gain(cls, values: Float) -> Scale:
        """Of what helps: from the least to the most that is known, of those above 0; from 0 where
        they are nearly alike, so that small differences do not look large."""
        known = np.maximum(values[np.isfinite(values)], 0.0)
        high = float(known.max(initial=0.0)) or 1.0
        low = float(known.min(initial=high))
        return cls(low if high - low > _ALIKE * high else 0.0, high, _VIRIDIS)

    def colors(self, values: Float) -> Float:
        """(n, 3) from 0 to 1, as a screen shows them (sRGB)."""
        table = np.array(self.anchors) / 255
        known = np.isfinite(values)
        share = np.where(known, (values - self.low) / (self.high - self.low), 0.0)
        at = np.clip(share, 0, 1) * (len(table) - 1)
        out = np.stack([np.interp(at, np.arange(len(table)), c) for c in table.T], axis=1)
        out[~known] = np.array(_UNKNOWN) / 255
        return out


def rounded_up(reach: float) -> float:
    """The next number that is good to read."""
    if not np.isfinite(reach) or reach < 1e-12:
        return 1e-6
    power = 10.0 ** np.floor(np.log10(reach))
    return float(next(r for r in (*_ROUND, 10.0) if r * power >= reach * (1 - 1e-9)) * power)


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
