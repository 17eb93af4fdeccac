"""Color scales for color-blind people, on light and dark pages, and their color bars."""

from __future__ import annotations

import html
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

#: Blue below zero and orange above (ColorBrewer's RdBu and PuOr); cividis; viridis.
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
_UNKNOWN_COLOR = (150, 150, 150)
_MIN_GAIN_SPREAD = 0.03  # share of the largest gain; smaller differences must not look large
#: Ends of ranges, times a power of ten; their quarters have few digits.
_ROUND_ENDS = (1.0, 1.2, 1.6, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0)
_MINUS = "\u2212"

# Layout of the color bar, in pixels of its drawing.
_BAR_WIDTH, _BAR_HEIGHT, _BAR_MARGIN, _BAR_THICKNESS = 280, 44, 24, 18
_BAR_STEPS = 64
_BAR_TICKS = 5


@dataclass(frozen=True)
class ColorScale:
    """Colors of the numbers from `low` to `high`.

    Numbers beyond the ends have the color of the end; unknown numbers (NaN) are gray.

    Attributes:
        low: Lower end.
        high: Upper end.
        anchors: RGB colors (0 to 255) at equal distances from `low` to `high`.
    """

    low: float
    high: float
    anchors: tuple[tuple[int, int, int], ...]

    @classmethod
    def symmetric(cls, reach: float) -> ColorScale:
        """Return a scale from -reach to reach, which is rounded up."""
        end = round_up(reach)
        return cls(-end, end, _DIVERGING)

    @classmethod
    def from_zero(cls, reach: float) -> ColorScale:
        """Return a scale from 0 to `reach`, which is rounded up."""
        return cls(0.0, round_up(reach), _CIVIDIS)

    @classmethod
    def for_gains(cls, values: Float) -> ColorScale:
        """Return a scale for gains: from the smallest to the largest positive number.

        It starts at 0 if the numbers are nearly equal, so that small differences do not look large.
        """
        gains = np.maximum(values[np.isfinite(values)], 0.0)
        high = float(gains.max(initial=0.0)) or 1.0
        low = float(gains.min(initial=high))
        return cls(low if high - low > _MIN_GAIN_SPREAD * high else 0.0, high, _VIRIDIS)

    def colors(self, values: Float) -> Float:
        """Return the sRGB colors (n, 3), 0 to 1, of values (n,)."""
        table = np.array(self.anchors) / 255
        is_known = np.isfinite(values)
        share = np.where(is_known, (values - self.low) / (self.high - self.low), 0.0)
        position = np.clip(share, 0, 1) * (len(table) - 1)
        colors = np.stack(
            [np.interp(position, np.arange(len(table)), channel) for channel in table.T], axis=1
        )
        colors[~is_known] = np.array(_UNKNOWN_COLOR) / 255
        return colors


def round_up(value: float) -> float:
    """Return the next number with few digits, at least 1e-6."""
    if not np.isfinite(value) or value < 1e-12:
        return 1e-6
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(r for r in (*_ROUND_ENDS, 10.0) if r * power >= value * (1 - 1e-9)) * power)


def color_bar(scale: ColorScale, title: str, unit: str, note: str) -> str:
    """Return a color bar with numbers below it as HTML.

    Its text has the page's own color, light or dark.

    Args:
        scale: The color scale.
        title: Text above the bar.
        unit: Unit of the numbers; may be empty.
        note: Text below the bar.
    """
    width = _BAR_WIDTH - 2 * _BAR_MARGIN
    step = width / _BAR_STEPS
    middles = scale.low + (np.arange(_BAR_STEPS) + 0.5) / _BAR_STEPS * (scale.high - scale.low)
    rgb = np.rint(255 * scale.colors(middles)).astype(int).tolist()
    boxes = "".join(
        f'<rect x="{_BAR_MARGIN + k * step:.2f}" y="2" width="{step + 0.4:.2f}"'
        f' height="{_BAR_THICKNESS}" fill="rgb({r},{g},{b})"/>'
        for k, (r, g, b) in enumerate(rgb)
    )
    bottom = _BAR_THICKNESS + 2
    ticks = "".join(
        f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{bottom}" y2="{bottom + 5}" stroke="currentColor"/>'
        f'<text x="{x:.1f}" y="{bottom + 18}" text-anchor="middle">{label}</text>'
        for x, label in zip(
            np.linspace(_BAR_MARGIN, _BAR_MARGIN + width, _BAR_TICKS),
            tick_labels(scale),
            strict=True,
        )
    )
    unit_text = f" ({html.escape(unit)})" if unit else ""
    return (
        '<div style="padding:0 0.8em;font-size:0.85em">'
        f"<div><b>{html.escape(title)}</b>{unit_text}</div>"
        f'<svg viewBox="0 0 {_BAR_WIDTH} {_BAR_HEIGHT}" width="100%" role="img"'
        f' aria-label="{html.escape(title)}" font-size="11" fill="currentColor">'
        f"{boxes}{ticks}</svg>"
        f'<div style="opacity:0.8">{html.escape(note)}</div></div>'
    )


def tick_labels(scale: ColorScale) -> list[str]:
    """Return the numbers below the color bar, at equal distances from end to end."""
    values = np.linspace(scale.low, scale.high, _BAR_TICKS)
    return [f"{value + 0.0:.3g}".replace("-", _MINUS) for value in values.tolist()]
