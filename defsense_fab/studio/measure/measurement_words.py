"""What is told while a specimen is measured, and what came of it."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...calibration.guided_measurement import MeasurementView
from ...calibration.session import CHANNELS
from .training_words import notes_list

_DOWN = {"a": ("bottom", "top"), "b": ("top", "bottom")}
#: Of cords by their place, told apart by all.
_COLORS = {"top": "#e69f00", "neutral": "#009e73", "bottom": "#0072b2"}
_WIDE, _HIGH = 260, 150  # pixels of the plot


def jig_words(view: MeasurementView) -> str:
    """Markdown: what to lay where, whether it has settled, what is read, what is wrong."""
    lines = [f"#### {view.done} of {view.total} readings"]
    if view.phase == "unplugged":
        lines.append("**The read-out board is gone.** Plug it in again; this step is then measured"
                     " from its beginning.")  # fmt: skip
    elif view.step is not None:
        down, up = _DOWN[view.step.face]
        jig = "the flat jig" if view.step.radius is None else f"jig {view.step.jig}"
        lines.append(
            f"Lay the specimen on **{jig}**, its **{down}** side on the jig, the {up} cord up;"
            " strap it down."
        )
        if view.phase == "place":
            lines.append("*Measure* when it lies.")
        elif view.phase == "settling":
            change = "" if view.settled is None else f", changes by {view.settled.change:.2%}"
            lines.append(f"Settling: {view.elapsed:.0f} s{change}.")
    ohm = [f"{name} {r:.0f} Ω" if np.isfinite(r) else f"{name} -"
           for name, r in zip(CHANNELS, view.ohm, strict=True)]  # fmt: skip
    lines.append(", ".join(ohm))
    lines += [f"- **{note}**" for note in view.notes]
    return "\n\n".join(lines)


def points_plot(view: MeasurementView) -> str:
    """HTML: finished readings, (R - R0)/R0 by strain; empty before the first."""
    good = [p for p in view.points if np.isfinite([p.strain, p.change]).all()]
    if not good:
        return ""
    most = max(*(abs(p.strain) for p in good), 1e-3), max(*(abs(p.change) for p in good), 1e-3)
    dots = "".join(
        f'<circle cx="{_WIDE / 2 * (1 + 0.95 * p.strain / most[0]):.1f}"'
        f' cy="{_HIGH / 2 * (1 - 0.95 * p.change / most[1]):.1f}" r="3"'
        f' fill="{_COLORS.get(p.place, "gray")}"/>'
        for p in good
    )
    legend = ", ".join(f'<span style="color:{c}">{html.escape(n)}</span>'
                       for n, c in _COLORS.items())  # fmt: skip
    return (
        f'<svg width="{_WIDE}" height="{_HIGH}" style="background:rgba(128,128,128,.12)">'
        f'<path d="M0 {_HIGH / 2}H{_WIDE}M{_WIDE / 2} 0V{_HIGH}" stroke="currentColor"'
        f' opacity=".4"/>{dots}</svg><div style="font-size:11px">(R - R0)/R0, &plusmn;'
        f"{most[1]:.0%}, by strain, &plusmn;{most[0]:.1%}: {legend}</div>"
    )


def response_words(result: Mapping[str, Any]) -> str:
    """Of a fit that has just ended."""
    d = result["data"]
    low, high = d["interval"]
    strains = d["strain_range"]
    return "\n\n".join(
        part
        for part in (
            f"**k_res = {d['k_res']:.2f}** (95 %: {low:.2f} to {high:.2f})",
            str(d["reason"]),
            f"Strains {strains[0]:.1%} to {strains[1]:.1%}, {d['readings']} readings of"
            f" {len(d['pieces'])} pieces. All of it: `{result['page']}`",
            notes_list(d["warnings"]),
        )
        if part
    )
