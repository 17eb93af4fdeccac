"""Builds on request: the parts are built of cords that the user has decided on."""

from __future__ import annotations

from ...core.errors import LayoutError
from ...workflow.build.build import freshness
from ..edits.cords import lock_cords
from ..messages.shell import StartBuild
from ..session.built_cords import built_cords, can_move_cords
from ..session.device_session import DeviceSession
from .optimize.ghost_cords import are_same


def start_build(session: DeviceSession, request: StartBuild) -> None:
    """Start a build.

    Args:
        session: The device.
        request: The stage, and whether the drawn cords are built as they are.

    Raises:
        LayoutError: The build would move the drawn cords, and nobody has decided on that.
        DefsenseError: Another job is running, or the script cannot be read.
    """
    if request.stage == "report" and would_move_cords(session):
        if request.cords == "ask":
            noun = session.device.cord.noun
            raise LayoutError(
                f"the drawn {noun}s are not locked, and the build would move them",
                code="cords-undecided",
                action=f"Build them as drawn, or use the {noun}s of a search",
            )
        session.jobs.check_idle()
        session.edit_and_lock(lock_cords())
    session.build(request.stage)


def would_move_cords(session: DeviceSession) -> bool:
    """Return whether parts that are built now would have other cords than the drawn ones."""
    device = session.device
    if not device.sensors or not can_move_cords(device):
        return False
    built = built_cords(session.results)
    is_current = freshness(device).get("optimize") == "current"
    return not (is_current and built is not None and are_same(built.sensors, device.sensors))
