"""Compute the forces with which handles and drags hold a solved pose.

The constraints of an equilibrium carry what the internal forces and the loads leave at their nodes.
Their resultant and moment follow from sums over the nodes of a region. If all prescribed movements
are proportional to an amplitude s, the power of these forces is dW/ds, the force that is conjugate
to the amplitude: the derivative of the stored energy, by the principle of virtual work.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, format_point
from ...core.rotations import rotation_matrices
from ..elements import tet10
from ..elements.material import Material
from ..elements.tet10 import QuadraticMesh
from ..loading.boundary_conditions import (
    BoundaryConditions,
    RigidHandle,
    interpolate_conditions,
)
from ..loading.loads import Loads


@dataclass(frozen=True)
class Reaction:
    """What holds one place of the body in a pose, in the rest frame.

    Attributes:
        place: Name of the moved region, or the rest position of a dragged point.
        force: Resultant force (3,) on the body, N.
        moment: Resultant moment (3,) about the moved center of the region's volume, N mm.
        power: Work per amplitude of the prescribed movement, N mm; the full pose has amplitude 1.
        push: Power divided by the root mean square speed of the region, N: the force that does the
            same work if it acts along the movement. It is negative where the body pulls the region
            on, after it snapped through.
    """

    place: str
    force: Float
    moment: Float
    power: float
    push: float


def find_reactions(
    mesh: QuadraticMesh,
    material: Material,
    conditions: BoundaryConditions,
    fraction: float,
    fields: tuple[Float, Float],
    step: float,
) -> tuple[Reaction, ...]:
    """Return the reactions at everything that a pose moves.

    Pressures, gravity and regions that stay in place are left out.

    Args:
        mesh: The mesh.
        material: Its material.
        conditions: Boundary conditions of the pose at its full amplitude, with its fibers.
        fraction: Amplitude of the state.
        fields: Displacements (n, 3) mm of the state, and of an earlier state of the pose.
        step: Difference of their amplitudes.
    """
    u, before = fields
    reached = interpolate_conditions(conditions, conditions, fraction, scale=True)
    loads = Loads(mesh, reached)
    F = tet10.deformation_gradient(mesh, u)
    external = loads.forces(reached, u, loads.pressure(reached, u))
    forces = tet10.forces(mesh, material, F) - external
    handles = tuple(
        _handle_reaction(h, fraction, mesh, u, forces, (u - before) / step)
        for h in conditions.handles
        if _is_moved(h)
    )
    pulls = loads.drag_forces(reached, u)
    drags = []
    for drag, pull in zip(conditions.drags, pulls, strict=True):
        power, speed = float(pull @ drag.by), float(np.linalg.norm(drag.by))
        place = f"{format_point(drag.at)} mm"
        drags.append(Reaction(place, pull, np.zeros(3), power, power / speed if speed else 0.0))
    return (*handles, *drags)


def _is_moved(handle: RigidHandle) -> bool:
    return bool(handle.rotation.any() or np.nan_to_num(handle.translation).any())


def _handle_reaction(
    handle: RigidHandle, fraction: float, mesh: QuadraticMesh, u: Float, force: Float, step: Float
) -> Reaction:
    """Return the reaction of a handle.

    Args:
        handle: The handle, its movement at the full amplitude.
        fraction: Amplitude of the state.
        mesh: The mesh.
        u: Displacements (n, 3) mm of the state.
        force: Forces (n, 3) N of the constraints.
        step: Mean change (n, 3) of the displacements per amplitude in the last step, mm.
    """
    nodes = handle.nodes
    volumes = np.bincount(mesh.cells.ravel(), np.repeat(mesh.weight, 10), len(mesh.nodes))[nodes]
    share = volumes / volumes.sum()
    middle = share @ mesh.nodes[nodes]
    center = middle + share @ u[nodes]
    arm = (mesh.nodes + u)[nodes] - center
    resultant = force[nodes].sum(axis=0)
    moment = np.cross(arm, force[nodes]).sum(axis=0)
    # The pivot moves with the region. Coordinates that are free carry no force.
    to_pivot = rotation_matrices(fraction * handle.rotation) @ (handle.center - middle)
    about_pivot = moment - np.cross(to_pivot, resultant)
    power = float(handle.rotation @ about_pivot + np.nan_to_num(handle.translation) @ resultant)
    # Turns are known exactly, if no axis is free; the center's path is almost straight in a step.
    moves = step[nodes]
    if not len(handle.free_axes):
        moves = share @ moves + np.cross(handle.rotation, arm)
    speed = float(np.sqrt(share @ (moves**2).sum(axis=1)))
    return Reaction(handle.name, resultant, moment, power, power / speed if speed else 0.0)
