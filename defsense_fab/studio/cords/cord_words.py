"""What the page says of a layout."""

from __future__ import annotations

from collections.abc import Sequence

from ...optimize.limits.verification import LayoutCheck
from ...optimize.prediction.layout_judge import Judged
from ..workbench.pose_errors import extremes
from ..workbench.table_cell import table_cell

_BARS = 9
_STRAIGHT = 1000.0  # mm, of a radius


def error_table(judged: Judged | None, before: Judged | None) -> str:
    """Markdown: the expected error, and by how much it differs from that `before` the drag; each
    pose at its extreme with a bar."""
    if judged is None:
        return "no cord yet: add one"
    change = ""
    if before is not None and abs(judged.error - before.error) >= 0.005:
        change = f" ({judged.error - before.error:+.2f})"
    lines = [f"### {judged.error:.2f} mm{change}", f"expected on unseen states ({judged.decoder})"]
    rows = extremes(judged.per_state)
    most = max(rows.values(), default=1.0)
    lines += ["", "| pose | mm | |", "|---|---:|---|"]
    lines += [
        f"| {table_cell(pose)} | {mm:.2f} | {'█' * max(round(_BARS * mm / most), 1)} |"
        for pose, mm in rows.items()
    ]
    return "\n".join(lines)


def limit_words(check: LayoutCheck, names: Sequence[str]) -> str:
    """Markdown: each cord's numbers, and what is broken."""
    lines = ["| cord | length | radius | wall |", "|---|---:|---:|---:|"]
    for name, cord in zip(names, check.cords, strict=True):
        whole = cord.length + sum(i for i in cord.inlets if i < 1e3)
        lines.append(
            f"| {table_cell(name)} | {whole:.0f} mm | {_radius(cord.min_radius)} |"
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
