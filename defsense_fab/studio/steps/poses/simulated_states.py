"""The states of the last simulation, with the forces that hold the device in them."""

from __future__ import annotations

from ....core.device.device import Device
from ....core.errors import DefsenseError
from ....workflow.build.results import Build, has_poses
from ...messages.poses import HeldForce, PoseForces, SimulatedState, SimulatedStates

_N_MM_PER_N_M = 1000.0
_DIGITS = 3
_SUCCESS = "ok"


def simulated_states(build: Build, device: Device, *, is_current: bool) -> SimulatedStates:
    """Return the states of a build; none before the simulation.

    Args:
        build: The build.
        device: The present device.
        is_current: Whether the states belong to it.
    """
    levels, states, warnings = list(device.states.ramp), list[SimulatedState](), list[str]()
    if has_poses(build):
        try:
            index = build.field_index
            states = [
                SimulatedState(
                    name=state.state,
                    weights=dict(state.weights),
                    is_held_out=state.held_out,
                    problem="" if state.status == _SUCCESS else state.status,
                )
                for state in index.states
            ]
            warnings = list(index.warnings)
        except (DefsenseError, OSError):  # a build replaces it, or it is damaged
            states = []
    return SimulatedStates(
        is_current=is_current and bool(states),
        levels=levels,
        states=states,
        forces=_forces(build) if states else [],
        warnings=warnings,
    )


def _forces(build: Build) -> list[PoseForces]:
    try:
        record = build.forces
    except (DefsenseError, OSError):  # not computed yet
        return []
    return [
        PoseForces(
            pose=pose.pose,
            state=pose.state,
            held=[
                HeldForce(
                    place=held.place,
                    push=round(held.push, _DIGITS),
                    torque=round(held.torque / _N_MM_PER_N_M, _DIGITS + 1),
                )
                for held in pose.held
            ],
            effort=pose.effort,
            warning=pose.warning,
        )
        for pose in record.poses
    ]
