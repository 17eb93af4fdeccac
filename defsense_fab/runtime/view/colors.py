"""Colours of cords and markers, as (n, 3) from 0 to 255."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ..frames.live_frame import Quality

#: The body by how far its shape is to be believed.
BODY = {
    Quality.TRUSTED: (120, 170, 215),
    Quality.UNTRAINED: (225, 185, 95),
    Quality.FALLBACK: (225, 145, 95),
    Quality.LOST: (150, 150, 150),
}
_SHORTER, _REST, _LONGER = (40, 90, 200), (225, 225, 225), (205, 35, 45)
#: Of the cords' signals over time, told apart by colour-blind people, too (Okabe & Ito 2008).
LINES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")
#: Markers as cameras saw them.
TRACKS = (20, 20, 20)
_SURE, _UNSURE = (40, 150, 80), (215, 40, 60)


def cord_color(signal: float, low: float, high: float) -> tuple[int, int, int]:
    """Blue where resistance falls, red where it rises, as far as it went in training."""
    if not np.isfinite(signal):
        return 90, 90, 90
    end, limit = (_LONGER, high) if signal > 0 else (_SHORTER, low)
    return _mixed(_REST, end, signal / limit if limit else 0.0)


def marker_colors(radius: Float, usual: float) -> Int:
    """Green where intervals are as wide as usual, red where they are three times that."""
    share = np.clip((np.nan_to_num(radius, nan=3 * usual) / max(usual, 1e-9) - 1) / 2, 0, 1)
    out = np.array(_SURE) + share[:, None] * (np.array(_UNSURE) - np.array(_SURE))
    return np.asarray(np.rint(out), dtype=np.uint8)


def _mixed(a: tuple[int, ...], b: tuple[int, ...], share: float) -> tuple[int, int, int]:
    x = min(max(share, 0.0), 1.0)
    r, g, blue = (round(p + x * (q - p)) for p, q in zip(a, b, strict=True))
    return r, g, blue
