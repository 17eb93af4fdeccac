"""Numbers as colours, and the bar that tells which is which."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.arrays import Float

_NAME = "viridis"  # told apart by the colour-blind, and seen on light and dark pages
_STEPS = 16


def colors(values: Float, top: float) -> Any:
    """(n, 4) from 0 to 255 of values (n,) between 0 and `top`; those above have its colour."""
    share = np.clip(values / max(top, 1e-12), 0, 1)
    return np.asarray(_map()(share, bytes=True), np.uint8)


def color_bar(top: float, largest: float, unit: str) -> str:
    """HTML: from 0 to `top`, and up to which number what is beyond has the last colour."""
    stops = ", ".join(
        "rgb({}, {}, {})".format(*_map()(k / _STEPS, bytes=True)[:3]) for k in range(_STEPS + 1)
    )
    ticks = "".join(f"<span>{top * k / 4:.3g}</span>" for k in range(5))
    beyond = f"; the brightest up to {largest:.3g}" if largest > top else ""
    return (
        f'<div style="padding: 0 0.8em; font-size: 0.8em"><div style="height: 1em; background:'
        f' linear-gradient(to right, {stops})"></div><div style="display: flex; justify-content:'
        f' space-between">{ticks}</div><div>{unit}{beyond}</div></div>'
    )


def _map() -> Callable[..., Any]:
    from matplotlib import colormaps

    return colormaps[_NAME]
