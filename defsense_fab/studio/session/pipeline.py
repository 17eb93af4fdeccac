"""The steps of the work: which are done, stale, ready or blocked, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..messages.shell import NextAction, Pipeline, StepName, StepState, StepStatus


@dataclass(frozen=True)
class LimitState:
    """What is known of the limits of the drawn cords.

    Attributes:
        is_broken: Whether they break a limit, or cannot be made.
        broken_cord: Name of the first cord that does; empty if that is not known.
        is_being_checked: Whether they keep the limits of their paths, and it is being checked
            whether they can be made.
        is_check_aborted: Whether that check has ended with an error.
    """

    is_broken: bool = False
    broken_cord: str = ""
    is_being_checked: bool = False
    is_check_aborted: bool = False


@dataclass(frozen=True)
class Progress:
    """What the state of the steps follows from.

    Attributes:
        freshness: State of each stage of the build: "current", "old" or "missing".
        has_body: Whether a body has been made.
        poses: Number of poses.
        cords: Number of drawn cords.
        proposed: Number of cords that the optimizer adds.
        can_move: Whether the optimizer may move or add cords.
        limits: What is known of the limits of the drawn cords.
        misfit: Which regions and poses are outside the body, in one sentence; empty for none.
        is_optimized: Whether the drawn cords are those that the last search found.
        noun: What one sensor is called.
        has_model: Whether a model was trained.
    """

    freshness: Mapping[str, str]
    has_body: bool
    poses: int
    cords: int
    proposed: int
    can_move: bool
    limits: LimitState
    misfit: str
    is_optimized: bool
    noun: str
    has_model: bool


def pipeline(progress: Progress) -> Pipeline:
    """Return the state of each step, and what to do next."""
    statuses = (
        ("body", *_body(progress)),
        ("poses", *_poses(progress)),
        ("inside", *_inside(progress)),
        ("sensors", *_sensors(progress)),
        ("optimize", *_optimize(progress)),
        ("make", *_make(progress)),
        ("measure", *_measure(progress)),
    )
    steps = [StepStatus(name=_step(n), state=state, text=text) for n, state, text in statuses]
    return Pipeline(steps=steps, next=next_action(progress))


def next_action(p: Progress) -> NextAction:
    """Return what to do next."""
    if not p.has_body:
        return NextAction(label="Make the body", hint="Run the script of the body", step="body")
    if not p.poses:
        return NextAction(label="Add a pose", hint="A pose is a deformation to sense", step="poses")
    if p.misfit:
        return NextAction(label="Fix the regions", hint=p.misfit, step="poses")
    if _state(p, "simulate") != "current":
        again = " again" if _state(p, "simulate") == "old" else ""
        return NextAction(
            label=f"Simulate the poses{again}",
            hint="Compute the deformation of each pose with finite elements",
            step="poses",
            stage="simulate",
        )
    if not p.cords and not p.proposed:
        return NextAction(
            label=f"Add a {p.noun}", hint=f"Draw a {p.noun}, or let one be proposed", step="sensors"
        )
    if p.limits.is_broken:
        return NextAction(
            label="Fix the limits",
            hint=f"A {p.noun} breaks a limit, and the parts cannot be made",
            step="sensors",
            cord=p.limits.broken_cord,
        )
    if _state(p, "optimize") != "current" and not p.is_optimized and p.can_move:
        return NextAction(
            label=f"Optimize the {p.noun}s",
            hint=f"Move the {p.noun}s that are not locked to reduce the error",
            step="optimize",
            stage="optimize",
        )
    if _state(p, "report") != "current":
        return NextAction(
            label="Build the parts",
            hint="Cut the body, add grooves, and write parts, guide and report",
            step="make",
            stage="report",
        )
    return NextAction(
        label="Run it live" if p.has_model else "Measure the device",
        hint="Without a printed device, its simulated twin takes its place",
        step="measure",
    )


def _body(p: Progress) -> tuple[StepState, str]:
    if not p.has_body:
        return "ready", "The body has not been made yet"
    if _state(p, "body") == "old":
        return "stale", "The body has changed since the last build"
    return "done", "The body is made"


def _poses(p: Progress) -> tuple[StepState, str]:
    if not p.has_body:
        return "blocked", "Make the body first"
    if not p.poses:
        return "ready", "No pose yet"
    if p.misfit:
        return "stale", p.misfit
    state = _state(p, "simulate")
    if state == "old":
        return "stale", "The body or the poses have changed since they were simulated"
    if state == "missing":
        return "ready", "The poses are not simulated yet"
    return "done", "The poses are simulated"


def _inside(p: Progress) -> tuple[StepState, str]:
    state = _state(p, "simulate")
    if state == "missing":
        return "blocked", "Simulate the poses first"
    if state == "old":
        return "stale", "The strains belong to an earlier body or to earlier poses"
    return "done", "The strains are known"


def _sensors(p: Progress) -> tuple[StepState, str]:
    if not p.has_body:
        return "blocked", "Make the body first"
    if not p.cords:
        return "ready", f"No {p.noun} yet"
    if p.limits.is_broken:
        return "stale", f"A {p.noun} breaks a limit"
    count = f"1 {p.noun}" if p.cords == 1 else f"{p.cords} {p.noun}s"
    if p.limits.is_being_checked:
        return "ready", f"{count}: checking whether the parts can be made"
    if p.limits.is_check_aborted:
        return "ready", f"{count}: it is not known whether the parts can be made"
    return "done", f"{count} within all limits"


def _optimize(p: Progress) -> tuple[StepState, str]:
    if not p.poses:
        return "blocked", "Add a pose first"
    if not p.cords and not p.proposed:
        return "blocked", f"Add a {p.noun} first"
    state = _state(p, "optimize")
    if not p.can_move:
        return "done", f"All {p.noun}s are locked: the parts contain them as drawn"
    if state == "old" and p.is_optimized:
        return "done", f"The drawn {p.noun}s are the optimized ones"
    if state == "old":
        return "stale", f"The device has changed since the {p.noun}s were optimized"
    if state == "missing":
        return "ready", f"The {p.noun}s are not optimized yet"
    return "done", f"The {p.noun}s are optimized"


def _make(p: Progress) -> tuple[StepState, str]:
    if not p.poses or not (p.cords or p.proposed):
        return "blocked", f"A pose and a {p.noun} are needed first"
    state = _state(p, "report")
    if state == "old" or (state == "missing" and _state(p, "fabricate") == "old"):
        return "stale", "The device has changed since the parts were built"
    if state == "missing":
        return "ready", "The parts are not built yet"
    return "done", "The parts are built"


def _measure(p: Progress) -> tuple[StepState, str]:
    if p.has_model:
        return "done", "A model is trained"
    if _state(p, "optimize") == "missing":
        return "blocked", f"Optimize the {p.noun}s first" if p.can_move else "Build the parts first"
    return "ready", "No model is trained yet"


def _state(p: Progress, stage: str) -> str:
    return p.freshness.get(stage, "missing")


def _step(name: str) -> StepName:
    return name  # type: ignore[return-value]  # one of the names above
