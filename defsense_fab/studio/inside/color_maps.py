"""Colours of numbers, told apart by colour-blind people, in light and dark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

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
