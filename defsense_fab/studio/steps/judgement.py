"""What is expected of cords, as the page gets it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.device.device import Sensor
from ...core.errors import LayoutError
from ...workflow.design.layout_judge import JudgedLayout, LayoutCheck, LayoutJudge
from ...workflow.view import Problem
from ..messages import sensors as messages
from ..session.cord_states import rounded

_STRAIGHT_RADIUS_MM = 1000.0  # a cord with a larger radius is shown as straight
_MAX_INLET_MM = 1e3  # an inlet that does not leave the body is infinite
_MAX_SHOWN_PLACES = 400  # where limits are broken


def judge(
    judge_: LayoutJudge, sensors: Sequence[Sensor], *, quick: bool
) -> tuple[messages.Judgement, Problem | None]:
    """Return what is expected of cords, and why no error can be predicted, if so."""
    check = judge_.check(sensors) if sensors else LayoutCheck((), None, (), np.zeros((0, 3)))
    problem, judged = None, None
    try:
        judged = judge_.judge(sensors, quick=quick)
    except LayoutError as error:
        problem = Problem.of(error)
    return describe_layout(sensors, judged, check), problem


def describe_layout(
    sensors: Sequence[Sensor], judged: JudgedLayout | None, check: LayoutCheck
) -> messages.Judgement:
    """Return what the page shows of cords: their error, if it is predicted, and their limits."""
    places = check.broken[:: len(check.broken) // _MAX_SHOWN_PLACES + 1]
    return messages.Judgement(
        error=None if judged is None else judged.error,
        trained=None if judged is None else judged.trained,
        decoder="" if judged is None else judged.decoder,
        poses=[]
        if judged is None
        else [
            messages.PoseError(
                pose=pose,
                error=mm,
                movement=judged.pose_movements[pose],
                signals=rounded(judged.pose_signals[pose]),
            )
            for pose, mm in judged.pose_errors.items()
        ],
        cords=[
            messages.CordNumbers(
                name=sensor.name,
                length=numbers.length + sum(x for x in numbers.inlets if x < _MAX_INLET_MM),
                radius=None if numbers.min_radius >= _STRAIGHT_RADIUS_MM else numbers.min_radius,
                wall=numbers.min_wall,
            )
            for sensor, numbers in zip(sensors, check.cords, strict=True)
        ],
        violations=[
            messages.Violation(code=v.code, text=str(v), cords=list(v.cords), at=list(v.at))
            for v in check.violations
        ],
        broken=rounded(places),
    )
