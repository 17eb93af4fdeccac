"""What the page says of a layout."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Sensor
from ...optimize.limits.verification import LayoutCheck
from ...optimize.prediction.layout_judge import JudgedLayout, LayoutJudge
from ..workbench.page_tables import escape_cell, full_pose_errors

# The cords' signals in each pose, as bars on the page.

#: Blue and orange are told apart by all; text takes the page's colour, light or dark.
_RISES, _FALLS = "#1f77b4", "#e67814"


def signal_bars(judged: JudgedLayout, cords: Sequence[str], chosen: str | None) -> str:
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


def _extreme_rows(judged: JudgedLayout) -> list[tuple[str, int]]:
    """Each pose, and the row of its farthest state."""
    names = list(judged.names)
    out = []
    for pose in full_pose_errors(judged.per_state):
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


# What cords give beside each other: markdown of what two sense, and what is lost without one.

#: Of two cords' signals over the states: above, one tells hardly anything that the other does not.
_ALIKE = 0.95


def comparison(
    judge: LayoutJudge, sensors: Sequence[Sensor], judged: JudgedLayout, chosen: str, other: str
) -> str:
    """The table of two cords by name: the error without each, their largest signals, and how far
    one follows the other over all states."""
    names = [s.name for s in sensors]
    rows = [names.index(chosen), names.index(other)]
    without = [_without(judge, sensors, judged, k) for k in rows]
    signals = judged.signals[:, rows]
    largest = np.abs(signals).max(axis=0)
    lines = [
        f"| | {escape_cell(chosen)} | {escape_cell(other)} |",
        "|---|---:|---:|",
        f"| error without it | {without[0]} | {without[1]} |",
        f"| largest signal | {100 * largest[0]:.1f} % | {100 * largest[1]:.1f} % |",
    ]
    alike = _correlation(signals)
    told = f"Their signals go together by {alike:+.2f} (1: the same)."
    if abs(alike) > _ALIKE:
        told += " One of them tells hardly anything new."
    return "\n".join([*lines, "", told])


def _without(judge: LayoutJudge, sensors: Sequence[Sensor], judged: JudgedLayout, k: int) -> str:
    left = [s for n, s in enumerate(sensors) if n != k]
    found = judge.judge(left, quick=True)
    if found is None:
        return "no cord is left"
    return f"{found.error:.2f} mm ({found.error - judged.error:+.2f})"


def _correlation(signals: np.ndarray) -> float:
    """Of two columns; 0 where one is constant."""
    off = signals - signals.mean(axis=0)
    sizes = np.linalg.norm(off, axis=0)
    if not sizes.all():
        return 0.0
    return float(off[:, 0] @ off[:, 1] / sizes.prod())


_BARS = 9
_STRAIGHT = 1000.0  # mm, of a radius


def error_table(judged: JudgedLayout | None, before: JudgedLayout | None) -> str:
    """Markdown: the expected error, and by how much it differs from that `before` the drag; each
    pose at its extreme with a bar."""
    if judged is None:
        return "no cord yet: add one"
    change = ""
    if before is not None and abs(judged.error - before.error) >= 0.005:
        change = f" ({judged.error - before.error:+.2f})"
    lines = [f"### {judged.error:.2f} mm{change}", f"expected on unseen states ({judged.decoder})"]
    rows = full_pose_errors(judged.per_state)
    most = max(rows.values(), default=1.0)
    lines += ["", "| pose | mm | |", "|---|---:|---|"]
    lines += [
        f"| {escape_cell(pose)} | {mm:.2f} | {'█' * max(round(_BARS * mm / most), 1)} |"
        for pose, mm in rows.items()
    ]
    return "\n".join(lines)


def limit_words(check: LayoutCheck, names: Sequence[str]) -> str:
    """Markdown: each cord's numbers, and what is broken."""
    lines = ["| cord | length | radius | wall |", "|---|---:|---:|---:|"]
    for name, cord in zip(names, check.cords, strict=True):
        whole = cord.length + sum(i for i in cord.inlets if i < 1e3)
        lines.append(
            f"| {escape_cell(name)} | {whole:.0f} mm | {_radius(cord.min_radius)} |"
            f" {cord.min_wall:.1f} mm |"
        )
    lines += ["", *(f"- {problem}" for problem in check.violations)]
    return "\n".join(lines)


def _radius(mm: float) -> str:
    return f"{mm:.0f} mm" if mm < _STRAIGHT else "straight"


def broken_cords(check: LayoutCheck, names: Sequence[str]) -> frozenset[str]:
    """Names of cords that break a limit, alone or with another."""
    return frozenset(
        name for name in names if any(name in problem.cords for problem in check.violations)
    )
