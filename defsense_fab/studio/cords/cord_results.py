"""Tables and bars of the Cords mode: expected errors, limits, signals and comparisons."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...workflow.design.layout_judge import CordComparison, JudgedLayout, LayoutCheck
from ..workbench.page_texts import bullet_list, escape_cell, markdown_table

#: Color-blind people can distinguish blue and orange.
_RISE_COLOR, _FALL_COLOR = "#1f77b4", "#e67814"
_MAX_BLOCKS = 9  # characters of the longest bar in the table of errors
_MIN_SHOWN_CHANGE_MM = 0.005  # smaller changes of an error are rounded to 0.00
_STRAIGHT_RADIUS_MM = 1000.0  # a cord with a larger radius is shown as straight
_MAX_INLET_MM = 1e3  # an inlet that does not leave the body is infinite


def comparison_table(comparison: CordComparison) -> str:
    """Return a comparison of two cords in markdown."""
    without = [
        "no cord left" if error is None else f"{error:.2f} mm ({error - comparison.error:+.2f})"
        for error in comparison.errors_without
    ]
    table = markdown_table(
        ["", *map(escape_cell, comparison.names)],
        [
            ["Error without it", *without],
            ["Largest signal", *(f"{100 * x:.1f} %" for x in comparison.largest_signals)],
        ],
    )
    correlation = f"Correlation of their signals: {comparison.correlation:+.2f}."
    if comparison.is_redundant:
        correlation += " One of them adds hardly any information."
    return f"{table}\n\n{correlation}"


def error_table(judged: JudgedLayout | None, before: JudgedLayout | None) -> str:
    """Return the expected error, and that of each pose at its extreme with a bar, in markdown.

    Args:
        judged: The prediction; None if there is no cord.
        before: The prediction before the current drag; the change of the error is shown.
    """
    if judged is None:
        return "No cord yet. Add one."
    change = ""
    if before is not None and abs(judged.error - before.error) >= _MIN_SHOWN_CHANGE_MM:
        change = f" ({judged.error - before.error:+.2f})"
    errors = judged.pose_errors
    largest = max(errors.values(), default=1.0)
    rows = [
        [escape_cell(pose), f"{mm:.2f}", "█" * max(round(_MAX_BLOCKS * mm / largest), 1)]
        for pose, mm in errors.items()
    ]
    trained = "" if judged.trained is None else f". After training: {judged.trained:.2f} mm"
    return (
        f"### {judged.error:.2f} mm{change}\n"
        f"Expected error in unseen states, without the cords' memory ({judged.decoder}"
        f" decoder){trained}\n\n" + markdown_table(["Pose", "mm", ""], rows, "lrl")
    )


def limits_table(check: LayoutCheck, names: Sequence[str]) -> str:
    """Return the measured numbers of each cord and the broken limits in markdown."""
    rows = []
    for name, cord in zip(names, check.cords, strict=True):
        length = cord.length + sum(inlet for inlet in cord.inlets if inlet < _MAX_INLET_MM)
        is_straight = cord.min_radius >= _STRAIGHT_RADIUS_MM
        radius = "straight" if is_straight else f"{cord.min_radius:.0f} mm"
        rows.append([escape_cell(name), f"{length:.0f} mm", radius, f"{cord.min_wall:.1f} mm"])
    table = markdown_table(["Cord", "Length", "Radius", "Wall"], rows)
    return f"{table}\n\n{bullet_list(map(str, check.violations))}"


def broken_cords(check: LayoutCheck) -> frozenset[str]:
    """Return the names of the cords that break a limit, alone or with another cord."""
    return frozenset(name for violation in check.violations for name in violation.cords)


def signal_bars(judged: JudgedLayout, cords: Sequence[str], chosen: str | None) -> str:
    """Return bars of the cords' signals in each pose at its extreme as HTML.

    A bar points to the right if the resistance rises and to the left if it falls. All bars have
    one scale.

    Args:
        judged: The prediction for the cords.
        cords: Their names.
        chosen: Name that is printed in bold, if any.
    """
    signals = judged.pose_signals
    if not signals or not len(cords):
        return ""
    largest = max(1e-9, *(float(np.abs(values).max()) for values in signals.values()))
    poses = "".join(
        _pose_bars(pose, values, cords, chosen, largest) for pose, values in signals.items()
    )
    return (
        f'<div style="font-size:11px;line-height:1.3">{poses}<div style="opacity:.7">Scale: '
        f"&plusmn;{100 * largest:.1f} % of R<sub>0</sub>. Blue: rises. Orange: falls.</div></div>"
    )


def _pose_bars(
    pose: str, values: Float, cords: Sequence[str], chosen: str | None, largest: float
) -> str:
    bars = "".join(
        _bar(cord, float(value), largest, is_chosen=cord == chosen)
        for cord, value in zip(cords, values, strict=True)
    )
    return f'<div style="margin-top:4px"><b>{html.escape(pose)}</b>{bars}</div>'


def _bar(cord: str, value: float, largest: float, *, is_chosen: bool) -> str:
    """Return one bar; its text has the color of the page, light or dark."""
    width = 50 * min(abs(value) / largest, 1.0)
    left = 50.0 if value >= 0 else 50.0 - width
    weight = "bold" if is_chosen else "normal"
    return (
        '<div style="display:flex;align-items:center;gap:4px">'
        f'<span style="width:28%;overflow:hidden;text-overflow:ellipsis;font-weight:{weight}">'
        f"{html.escape(cord)}</span>"
        '<span style="flex:1;position:relative;height:9px;background:rgba(128,128,128,.18)">'
        f'<span style="position:absolute;left:{left:.1f}%;width:{width:.1f}%;height:9px;'
        f'background:{_RISE_COLOR if value >= 0 else _FALL_COLOR}"></span>'
        '<span style="position:absolute;left:50%;width:1px;height:9px;background:currentColor">'
        "</span></span>"
        f'<span style="width:18%;text-align:right">{100 * value:+.1f} %</span></div>'
    )
