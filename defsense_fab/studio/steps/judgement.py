"""What is expected of cords, as the page gets it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.device.device import Sensor
from ...core.errors import LayoutError
from ...workflow.build.results import describe_error, grade_error
from ...workflow.design.cord_trial import CordTrial
from ...workflow.design.layout_judge import JudgedLayout, LayoutCheck, LayoutJudge
from ...workflow.view import Problem
from ..messages import sensors as messages
from ..session.built_cords import BuiltCords
from ..session.cord_check import CheckState
from ..session.cord_states import rounded
from ..session.device_session import DeviceSession

_STRAIGHT_RADIUS_MM = 1000.0  # a cord with a larger radius is shown as straight
_MAX_INLET_MM = 1e3  # an inlet that does not leave the body is infinite
_MAX_SHOWN_PLACES = 400  # where limits are broken
#: By which rounding in `device.toml` may change an error, mm.
SAME_ERROR_MM = 0.005


def simulated_judge(session: DeviceSession) -> LayoutJudge:
    """Return what predicts the error of cords.

    Raises:
        LayoutError: The poses are not simulated.
    """
    if session.judge is None:
        raise LayoutError(
            "the poses are not simulated yet",
            code="not-simulated",
            action="Simulate the poses first",
        )
    return session.judge


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
        decoder="" if judged is None else judged.decoder,
        poses=[]
        if judged is None
        else [
            messages.PoseError(
                pose=pose,
                error=mm,
                movement=judged.pose_movements[pose],
                travel=judged.pose_travels[pose],
                grade=grade_error(mm, judged.pose_travels[pose]),
                text=describe_error(mm, judged.pose_travels[pose]),
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


def describe_check(
    state: CheckState, trial: CordTrial | None, built: BuiltCords | None
) -> messages.PartsCheck:
    """Return what the page shows of cords that were made on trial.

    Args:
        state: What is known of them.
        trial: The result, or None.
        built: The cords of the last build, if they are the same; else None.
    """
    if trial is None:
        return messages.PartsCheck(state="none" if state == "done" else state)
    if trial.problem is not None:
        problem = trial.problem
        violation = messages.Violation(
            code=problem.code, text=problem.text, cords=list(problem.cords), at=list(problem.at)
        )
        return messages.PartsCheck(state="failed", problem=violation)
    numbers = trial_numbers(trial, built)
    return messages.PartsCheck(
        state="passed", error=numbers.error, in_use=list(numbers.in_use), parts=trial.parts
    )


@dataclass(frozen=True)
class TrialNumbers:
    """Errors of cords in their parts.

    Attributes:
        error: Expected error, mm.
        in_use: Error in use, mm: its median, and the limits of 90 % of built devices; empty if it
            is not known.
    """

    error: float | None
    in_use: tuple[float, ...]


def trial_numbers(trial: CordTrial, built: BuiltCords | None) -> TrialNumbers:
    """Return the errors of cords that were made on trial, or those of a build with the same cords.

    The file rounds paths, so that both may differ in the last shown digit; the page shows one.
    """
    drawn = float("nan") if trial.error is None else trial.error
    if built is not None and abs(built.error - drawn) < SAME_ERROR_MM:
        return TrialNumbers(built.error, built.in_use)
    if trial.band is None:
        return TrialNumbers(trial.error, ())
    trained = trial.band.trained
    return TrialNumbers(trial.error, (trained.median, trained.low, trained.high))
