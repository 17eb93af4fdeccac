"""What is told while a device is recorded: what to do next, and how much of each pose was seen."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping

from ...capture.sessions.guided_recording import CaptureView
from ...core.arrays import Bool

_SEEN, _NOT = "#1f77b4", "rgba(128,128,128,.25)"
_THEN = {
    "ready": "*Begin* when you are ready.",
    "showing": "Now.",
    "done": "",
}


def step_words(view: CaptureView) -> str:
    """Markdown: which step, what to do, what is there, what is wrong."""
    name, seconds = view.steps[view.step]
    left = view.left if view.phase == "showing" else seconds
    lines = [
        f"#### {view.step + 1} of {len(view.steps)}: {name}, {left:.0f} s",
        f"**{view.next}** {_THEN.get(view.phase, '')}",
    ]
    counts = [f"{view.samples} samples"]
    if view.cameras:
        counts.append(f"{view.frames} pictures")
        counts.append(f"tags: {view.several} of {view.tags} by several cameras, {view.single} by"
                      " one")  # fmt: skip
    if math.isfinite(view.residual):
        counts.append(f"residual {view.residual:.2f} px")
    lines.append("; ".join(counts))
    lines += [f"- **{note}**" for note in view.notes]
    return "\n\n".join(lines)


def coverage_bars(reached: Mapping[str, tuple[float, Bool]]) -> str:
    """HTML: of each pose the parts of its way, from rest to its extreme, that were seen; empty
    where that is not known."""
    if not reached:
        return ""
    rows = "".join(_pose(name, most, seen) for name, (most, seen) in reached.items())
    return (
        f'<div style="font-size:11px;line-height:1.4">{rows}<div style="opacity:.7">'
        "of the way from rest to each pose, seen so far</div></div>"
    )


def _pose(name: str, most: float, seen: Bool) -> str:
    parts = "".join(
        f'<span style="flex:1;height:9px;margin-right:2px;background:{_SEEN if part else _NOT}">'
        "</span>"
        for part in seen
    )
    return (
        '<div style="display:flex;align-items:center;gap:4px">'
        f'<span style="width:30%;overflow:hidden;text-overflow:ellipsis">{html.escape(name)}</span>'
        f'<span style="flex:1;display:flex">{parts}</span>'
        f'<span style="width:14%;text-align:right">{100 * most:.0f} %</span></div>'
    )
