"""Find a cord to add that lowers the error and can be made."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.device.device import Sensor
from ...core.errors import LayoutError
from ...core.progress import Report
from ...workflow.design.layout_judge import LayoutJudge
from ..session.cord_check import CordCheck, Cords


@dataclass(frozen=True)
class Proposal:
    """A cord that can be made together with the drawn ones.

    Attributes:
        cord: The cord.
        error: Expected error with it, in the parts, mm.
        error_before: Expected error without it, in the parts, mm; None if no cords are drawn.
    """

    cord: Sensor
    error: float | None
    error_before: float | None


def makeable_proposal(
    judge: LayoutJudge, check: CordCheck, sensors: Cords, name: str, report: Report
) -> Proposal:
    """Return the first proposed cord that can be made together with the drawn ones.

    Args:
        judge: Searches for cords.
        check: Makes cords on trial.
        sensors: The drawn cords.
        name: Name of the new cord.
        report: Called with the progress; what it raises ends the search.

    Raises:
        LayoutError: The drawn cords cannot be made, no proposed cord can be made with them, or the
            body has no room for another cord.
    """
    drawn = check.make_now(sensors) if sensors else None
    if drawn is not None and (problem := drawn.problem) is not None:
        raise LayoutError(
            f"the drawn cords cannot be made: {problem.text.rstrip('.')}",
            code="cords-not-makeable",
            action="Fix or delete this cord before another one is proposed",
            cord=problem.cords[0],
        )
    problems = []
    for cord in judge.proposals(name, sensors, report):
        trial = check.make_now((*sensors, cord))
        if trial.problem is None:
            return Proposal(cord, trial.error, None if drawn is None else drawn.error)
        problems.append(trial.problem.text)
    raise LayoutError(
        f"none of {len(problems)} proposed cords can be made with the drawn ones: {problems[0]}",
        code="no-makeable-proposal",
        action="Move a drawn cord, or make the body larger",
        problems=problems,
    )
