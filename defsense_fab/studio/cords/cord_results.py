"""Tables and bars of the Cords mode: expected errors, limits, signals and comparisons."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Sensor
from ...optimize.limits.verification import LayoutCheck
from ...optimize.prediction.layout_judge import JudgedLayout, LayoutJudge
from ..workbench.page_tables import escape_cell, full_pose_errors

#: Correlation of two cords' signals above which one of them adds hardly any information.
_REDUNDANT_CORRELATION = 0.95
#: Color-blind people can distinguish blue and orange.
_RISE_COLOR, _FALL_COLOR = "#1f77b4", "#e67814"
_MAX_BLOCKS = 9  # characters of the longest bar in the table of errors
_MIN_SHOWN_CHANGE_MM = 0.005  # smaller changes of an error are rounded to 0.00
_STRAIGHT_RADIUS_MM = 1000.0  # a cord with a larger radius is shown as straight
_MAX_INLET_MM = 1e3  # an inlet that does not leave the body is infinite


@dataclass(frozen=True)
class CordComparison:
    """Two cords of a layout next to each other.

    Attributes:
        names: The two cords.
        errors_without: Expected error of the layout without each of them, mm; None if no cord
            would be left.
        error: Expected error of the whole layout, mm.
        largest_signals: Largest absolute relative change of resistance of each cord.
        correlation: Pearson correlation of their signals over all states, 0 if one is constant.
    """

    names: tuple[str, str]
    errors_without: tuple[float | None, float | None]
    error: float
    largest_signals: tuple[float, float]
    correlation: float

    @property
    def is_redundant(self) -> bool:
        """Whether one of the cords adds hardly any information."""
        return abs(self.correlation) > _REDUNDANT_CORRELATION


def compare_cords(
    judge: LayoutJudge, sensors: Sequence[Sensor], judged: JudgedLayout, names: tuple[str, str]
) -> CordComparison:
    """Compare two cords of a layout.

    Args:
        judge: Predicts the errors of the layouts without each cord.
        sensors: All cords of the layout.
        judged: Prediction for all cords.
        names: The two cords.
    """
    indices = [[s.name for s in sensors].index(name) for name in names]
    first, second = (_error_without(judge, sensors, index) for index in indices)
    signals = judged.signals[:, indices]
    largest = np.abs(signals).max(axis=0)
    return CordComparison(
        names,
        (first, second),
        judged.error,
        (float(largest[0]), float(largest[1])),
        _correlation(signals),
    )


def comparison_table(comparison: CordComparison) -> str:
    """Return a comparison of two cords in markdown."""
    first, second = (escape_cell(name) for name in comparison.names)
    without = [
        "no cord left" if error is None else f"{error:.2f} mm ({error - comparison.error:+.2f})"
        for error in comparison.errors_without
    ]
    largest = comparison.largest_signals
    correlation = f"Correlation of their signals: {comparison.correlation:+.2f}."
    if comparison.is_redundant:
        correlation += " One of them adds hardly any information."
    return "\n".join(
        [
            f"| | {first} | {second} |",
            "|---|---:|---:|",
            f"| Error without it | {without[0]} | {without[1]} |",
            f"| Largest signal | {100 * largest[0]:.1f} % | {100 * largest[1]:.1f} % |",
            "",
            correlation,
        ]
    )


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
    lines = [
        f"### {judged.error:.2f} mm{change}",
        f"Expected error in unseen states ({judged.decoder} decoder)",
        "",
        "| Pose | mm | |",
        "|---|---:|---|",
    ]
    errors = full_pose_errors(judged.per_state)
    largest = max(errors.values(), default=1.0)
    lines += [
        f"| {escape_cell(pose)} | {error:.2f} |"
        f" {'█' * max(round(_MAX_BLOCKS * error / largest), 1)} |"
        for pose, error in errors.items()
    ]
    return "\n".join(lines)


def limits_table(check: LayoutCheck, names: Sequence[str]) -> str:
    """Return the measured numbers of each cord and the broken limits in markdown."""
    lines = ["| Cord | Length | Radius | Wall |", "|---|---:|---:|---:|"]
    for name, cord in zip(names, check.cords, strict=True):
        length = cord.length + sum(inlet for inlet in cord.inlets if inlet < _MAX_INLET_MM)
        radius = f"{cord.min_radius:.0f} mm"
        if cord.min_radius >= _STRAIGHT_RADIUS_MM:
            radius = "straight"
        lines.append(
            f"| {escape_cell(name)} | {length:.0f} mm | {radius} | {cord.min_wall:.1f} mm |"
        )
    lines += ["", *(f"- {violation}" for violation in check.violations)]
    return "\n".join(lines)


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
    rows = _extreme_rows(judged)
    if not rows or not len(cords):
        return ""
    signals = judged.signals[[row for _, row in rows]]
    largest = max(float(np.abs(signals).max()), 1e-9)
    poses = "".join(
        _pose_bars(name, values, cords, chosen, largest)
        for (name, _), values in zip(rows, signals, strict=True)
    )
    return (
        f'<div style="font-size:11px;line-height:1.3">{poses}<div style="opacity:.7">Scale: '
        f"&plusmn;{100 * largest:.1f} % of R<sub>0</sub>. Blue: rises. Orange: falls.</div></div>"
    )


def _error_without(judge: LayoutJudge, sensors: Sequence[Sensor], index: int) -> float | None:
    judged = judge.judge([s for k, s in enumerate(sensors) if k != index], quick=True)
    return None if judged is None else judged.error


def _correlation(signals: Float) -> float:
    """Return the correlation of two columns, 0 if one of them is constant."""
    deviations = signals - signals.mean(axis=0)
    norms = np.linalg.norm(deviations, axis=0)
    if not norms.all():
        return 0.0
    return float(deviations[:, 0] @ deviations[:, 1] / norms.prod())


def _extreme_rows(judged: JudgedLayout) -> list[tuple[str, int]]:
    """Return each pose and the index of its largest single state."""
    rows = []
    for pose in full_pose_errors(judged.per_state):
        levels = [
            (float(state.partition("@")[2]), row)
            for row, state in enumerate(judged.names)
            if state.partition("@")[0] == pose and "+" not in state
        ]
        if levels:
            rows.append((pose, max(levels)[1]))
    return rows


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
