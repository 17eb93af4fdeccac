"""The cords' signals in each pose, as bars on the page."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...optimize.prediction.layout_judge import Judged
from ..workbench.pose_errors import extremes

#: Blue and orange are told apart by all; text takes the page's colour, light or dark.
_RISES, _FALLS = "#1f77b4", "#e67814"


def signal_bars(judged: Judged, cords: Sequence[str], chosen: str | None) -> str:
    """HTML: for each pose at its extreme a bar of each cord's change of resistance, to the right
    where it rises and to the left where it falls, all on one scale."""
    rows = _extreme_rows(judged)
    if not rows or not len(cords):
        return ""
    values = judged.signals[[at for _, at in rows]]
    most = max(float(np.abs(values).max()), 1e-9)
    pairs = zip(rows, values, strict=True)
    body = "".join(_pose(name, v, cords, chosen, most) for (name, _), v in pairs)
    return (
        f'<div style="font-size:11px;line-height:1.3">{body}<div style="opacity:.7">scale: '
        f"&plusmn;{100 * most:.1f} % of R<sub>0</sub>; blue rises, orange falls</div></div>"
    )


def _extreme_rows(judged: Judged) -> list[tuple[str, int]]:
    """Each pose, and the row of its farthest state."""
    names = list(judged.names)
    out = []
    for pose in extremes(judged.per_state):
        levels = [(float(n.partition("@")[2]), k) for k, n in enumerate(names)
                  if n.partition("@")[0] == pose and "+" not in n]  # fmt: skip
        if levels:
            out.append((pose, max(levels)[1]))
    return out


def _pose(name: str, values: Float, cords: Sequence[str], chosen: str | None, most: float) -> str:
    bars = "".join(
        _bar(cord, float(v), most, cord == chosen) for cord, v in zip(cords, values, strict=True)
    )
    return f'<div style="margin-top:4px"><b>{html.escape(name)}</b>{bars}</div>'


def _bar(cord: str, value: float, most: float, chosen: bool) -> str:
    width = 50 * min(abs(value) / most, 1.0)
    left = 50.0 if value >= 0 else 50.0 - width
    weight = "bold" if chosen else "normal"
    return (
        '<div style="display:flex;align-items:center;gap:4px">'
        f'<span style="width:28%;overflow:hidden;text-overflow:ellipsis;font-weight:{weight}">'
        f"{html.escape(cord)}</span>"
        '<span style="flex:1;position:relative;height:9px;background:rgba(128,128,128,.18)">'
        f'<span style="position:absolute;left:{left:.1f}%;width:{width:.1f}%;height:9px;'
        f'background:{_RISES if value >= 0 else _FALLS}"></span>'
        '<span style="position:absolute;left:50%;width:1px;height:9px;background:currentColor">'
        "</span></span>"
        f'<span style="width:18%;text-align:right">{100 * value:+.1f} %</span></div>'
    )
