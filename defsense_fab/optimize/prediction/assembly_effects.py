"""How far held cords, which are stretched as they are laid, pull a soft body out of its shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Int
from ...core.device.device import Device
from ...core.errors import DeviceError
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.boundary_conditions import BoundaryConditions
from ...mechanics.loading.constraint_check import check_constraints
from ...mechanics.solver.linear_response import line_forces, small_load_displacement
from ...mechanics.solver.linear_solver import NotPositiveDefinite
from ...sensing.built_cord import BuiltCord
from .design_task import DesignTask


def pulls(device: Device, task: DesignTask, cords: Sequence[BuiltCord], error: float) -> list[str]:
    """What is to be said where held cords move the markers at rest, the first pose's fixed regions
    in their places, by more than the `error` (mm) that is promised; both are root mean squares.
    Cords pull by their pre-stretch, and the body's answer is linear. Nothing is said where these
    regions alone do not hold the body, or where its matrix takes more memory than there is."""
    taut = [(c.path, _rod(device) * c.prestretch) for c in cords if c.prestretch]
    locator = task.everything.locator
    if not taut or (fixed := _fixed(device, locator.mesh)) is None:
        return []
    forces = np.sum([line_forces(locator, path, tension) for path, tension in taut], axis=0)
    try:
        u = small_load_displacement(
            locator.mesh, Material.from_spec(device.material), fixed, forces
        )
    except (NotPositiveDefinite, MemoryError):  # a note is not worth a build
        return []
    at = locator.displacement(locator.find(task.points), u[None])[0]
    moved = float(np.sqrt((at**2).sum(axis=1) @ task.everything.marker_weights))
    if moved <= error:
        return []
    return [
        f"stretched as they are laid, cords pull with up to {max(t for _, t in taut):.2g} N, and"
        f" move the surface by about {moved:.2g} mm (root mean square) at rest: cords of"
        f" {device.cord.modulus:g} MPa in {device.material.name} of"
        f" {device.material.young_modulus:.2g} MPa. That is not in the simulation; training takes"
        " the rest as it finds it"
    ]


def _rod(device: Device) -> float:
    """A cord's tension over its strain, N."""
    return device.cord.modulus * np.pi / 4 * device.cord.diameter**2


def _fixed(device: Device, mesh: QuadraticMesh) -> Int | None:
    """The nodes that the first pose fixes, or None where these alone do not hold the body."""
    regions = next((p.fixed for p in device.poses if p.fixed), ())
    inside = [device.regions[r].contains(mesh.nodes) for r in regions]
    fixed = np.flatnonzero(np.any(inside, axis=0)) if inside else np.zeros(0, int)
    try:
        check_constraints(mesh, BoundaryConditions(fixed), "rest")
    except DeviceError:
        return None
    return fixed
