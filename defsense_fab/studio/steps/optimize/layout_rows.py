"""Layouts side by side as the page gets them, with the same numbers for each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ....core.device.device import Device, Sensor
from ....core.errors import DefsenseError
from ....workflow.design.compare_layouts import DRAWN, STRAIGHT, ComparedLayout, tried_as
from ....workflow.design.cord_trial import CordTrial
from ....workflow.design.layout_judge import LayoutJudge
from ....workflow.fabrication.print_time import print_hours
from ...edits.edit import free_name
from ...messages.optimize import LayoutRow, Role
from ..judgement import SAME_ERROR_MM
from .comparison_job import by_error
from .ghost_cords import are_same, ghost_cords

EARLIER = "earlier: "  # start of the names of layouts of an earlier design
_MAX_EARLIER = 6
_MAX_INLET_MM = 1e3  # an inlet that does not leave the body is infinite


@dataclass(frozen=True)
class RowContext:
    """What the numbers of layouts are computed from.

    Attributes:
        device: The device.
        judge: Measures cords; None until the poses are simulated.
        trial: The drawn cords with their parts on trial; None if these are not made.
    """

    device: Device
    judge: LayoutJudge | None
    trial: CordTrial | None = None


def without_outdated(
    layouts: Sequence[ComparedLayout], drawn: Sequence[Sensor]
) -> list[ComparedLayout]:
    """Drop the compared drawn cords if they have changed since, or are those of another layout."""
    others = [layout for layout in layouts if layout.name != DRAWN]
    if any(are_same(layout.sensors, drawn) for layout in others):
        return others
    return [x for x in layouts if x.name != DRAWN or are_same(x.sensors, drawn)]


def earlier_layouts(
    before: Sequence[ComparedLayout], now: Sequence[ComparedLayout], drawn: Sequence[Sensor]
) -> list[ComparedLayout]:
    """Return the layouts that another build has replaced, the most accurate ones.

    Args:
        before: Layouts of earlier builds.
        now: Layouts of the present build.
        drawn: The drawn cords, which have a row of their own.
    """
    kept: list[ComparedLayout] = []
    for layout in by_error(before):
        others = (drawn, *(other.sensors for other in (*now, *kept)))
        is_new = not any(are_same(layout.sensors, sensors) for sensors in others)
        if is_new and layout.sensors and layout.problem is None:
            kept.append(layout)
    kept = kept[:_MAX_EARLIER]
    names: list[str] = []
    for layout in kept:
        name = layout.name if layout.name.startswith(EARLIER) else f"{EARLIER}{layout.name}"
        names.append(free_name(name, names))
    return [replace(x, is_built=False, name=n) for x, n in zip(kept, names, strict=True)]


def with_drawn(context: RowContext, layouts: Sequence[ComparedLayout]) -> list[ComparedLayout]:
    """Return the layouts with the drawn cords first, if they are not those of a layout.

    The numbers of the drawn cords are those of their parts on trial, which Sensors shows, too.
    """
    sensors = context.device.sensors
    if not sensors:
        return list(layouts)
    trial = context.trial
    same = next((layout for layout in layouts if are_same(layout.sensors, sensors)), None)
    if same is not None:
        if trial is None or (same.is_built and _is_confirmed(same, trial)):
            return list(layouts)
        tried = replace(
            tried_as(same.name, trial), is_built=same.is_built, is_studied=same.is_studied
        )
        return [tried if layout is same else layout for layout in layouts]
    return [_judged(context) if trial is None else tried_as(DRAWN, trial), *layouts]


def _is_confirmed(built: ComparedLayout, trial: CordTrial) -> bool:
    """Return whether cords still have the error of their build, as Sensors shows it, too."""
    return trial.error is not None and abs(built.error - trial.error) < SAME_ERROR_MM


def _judged(context: RowContext) -> ComparedLayout:
    """Return the drawn cords, which were not made on trial, as a layout."""
    sensors, error = context.device.sensors, math.nan
    if context.judge is not None:
        try:
            judged = context.judge.judge(sensors)
        except DefsenseError:
            judged = None
        if judged is not None:
            error = judged.error
    return ComparedLayout(DRAWN, sensors, error, drawn_error=error)


def best_layout(layouts: Sequence[ComparedLayout]) -> tuple[str, str]:
    """Return the name of the layout to use after a search, or why there is none.

    It is the layout that the build has chosen, if it can be made, else the most accurate that was
    made on trial.
    """
    tried = [layout for layout in layouts if layout.name not in (DRAWN, STRAIGHT)]
    chosen = next((layout for layout in tried if layout.is_built), None)
    if chosen is None:
        return "", ""
    if chosen.problem is None:
        return chosen.name, ""
    made = [layout for layout in by_error(tried) if layout.problem is None and layout.parts]
    return (made[0].name, "") if made else ("", chosen.problem)


def layout_rows(context: RowContext, layouts: Sequence[ComparedLayout]) -> list[LayoutRow]:
    """Return the rows of layouts, the drawn one first, the others by increasing error."""
    drawn = context.device.sensors
    rows = [_row(context, layout, are_same(layout.sensors, drawn)) for layout in by_error(layouts)]
    return sorted(rows, key=lambda row: not row.is_drawn)


def is_complete(layouts: Sequence[ComparedLayout]) -> bool:
    """Return whether a comparison has computed all numbers of the layouts."""
    names = {layout.name for layout in layouts}
    return STRAIGHT in names and all(
        layout.is_studied
        or layout.problem is not None
        or (layout.parts is not None and layout.band is not None)
        for layout in layouts
    )


def _row(context: RowContext, layout: ComparedLayout, is_drawn: bool) -> LayoutRow:
    trained = layout.trained or (math.nan, math.nan, math.nan)
    role, fabrication = _role(layout), context.device.fabrication
    pieces = layout.pieces * fabrication.copies
    return LayoutRow(
        name=layout.name,
        role=role,
        is_drawn=is_drawn,
        error=_finite(layout.error),
        drawn_error=_finite(layout.drawn_error),
        trained=_finite(trained[0]),
        trained_low=_finite(trained[1]),
        trained_high=_finite(trained[2]),
        parts=layout.parts,
        print_hours=print_hours(fabrication, pieces) if pieces else None,
        length=None if role == "earlier" else _length(context.judge, layout.sensors),
        planes=layout.planes,
        cords=ghost_cords(layout.sensors),
        notes=list(layout.warnings),
        problem=layout.problem or "",
    )


def _role(layout: ComparedLayout) -> Role:
    if layout.name.startswith(EARLIER):
        return "earlier"
    if layout.is_built:
        return "built"
    if layout.is_studied:
        return "studied"
    if layout.name == DRAWN:
        return "drawn"
    return "straight" if layout.name == STRAIGHT else "candidate"


def _length(judge: LayoutJudge | None, sensors: Sequence[Sensor]) -> float | None:
    """Return the length of cords with their inlets, mm."""
    if judge is None or not sensors:
        return None
    return sum(
        cord.length + sum(x for x in cord.inlets if x < _MAX_INLET_MM)
        for cord in judge.check(sensors).cords
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
