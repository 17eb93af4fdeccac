"""Which version of the device the parts belong to, in sentences."""

from __future__ import annotations

from ....workflow.view import Problem
from ...messages.make import MakeState
from .build_state import BuildState


def make_state(state: BuildState, build_obstacle: str, problem: Problem | None) -> MakeState:
    """Return the state of the parts as the page gets it.

    Args:
        state: Which version of the device the parts belong to.
        build_obstacle: Why the parts cannot be built; empty if they can.
        problem: Why the last build failed, or None.
    """
    text, detail = _texts(state)
    cords = state.cords if state.is_built else None
    obstacles = {
        "not-built": "There is nothing to export before the parts are built",
        "outdated": "The parts belong to an earlier device: build them first",
    }
    return MakeState(
        code=state.code,  # type: ignore[arg-type]  # one of the codes of BuildState
        text=text,
        detail=detail,
        build_obstacle=build_obstacle,
        export_obstacle=obstacles.get(state.code, ""),
        problem=problem,
        cords=_cords_text(state),
        are_cords_drawn=state.are_cords_drawn,
        error=cords.error if cords is not None else None,
        in_use=list(cords.in_use) if cords is not None else [],
    )


def _cords_text(state: BuildState) -> str:
    """Return which cords the parts contain, and whether Sensors shows them."""
    cords, noun = state.cords, state.noun
    if not state.is_built or cords is None:
        return ""
    if not cords.is_moved:
        contained = f"The parts contain the drawn {noun}s"
    else:
        count = "" if cords.parts is None else f" of {cords.parts} parts"
        contained = f"The parts contain the optimized layout{count}"
    if state.are_cords_drawn:
        return f"{contained}, as Sensors shows them now."
    return f"{contained}. Sensors shows other {noun}s now."


def _texts(state: BuildState) -> tuple[str, str]:
    """Return a sentence, and a second one with what has changed or what to do."""
    if not state.is_built:
        return "The parts are not built yet.", ""
    if state.outdated_stage is not None:
        changes = f" ({state.changes})" if state.changes else ""
        return (
            "The device has changed since the parts were built.",
            f"The first outdated stage is “{state.outdated_stage}”{changes}. The parts below stay"
            " until the next build.",
        )
    if state.options:
        return (
            "The parts are up to date, with other options than those of the device.",
            f"They were built with {state.options}. To keep these options, set them under"
            " [fabrication] in device.toml.",
        )
    return "The parts are up to date.", ""
