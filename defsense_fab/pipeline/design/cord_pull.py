"""How far held cords, which are stretched as they are laid, pull a soft body out of its shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Int
from ...core.device.device import Device
from ...core.errors import DeviceError
from ...mechanics.elements.material import Material
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.boundary_conditions import BoundaryConditions
from ...mechanics.loading.constraint_check import check_constraints
from ...mechanics.solver.small_loads import displaced, line_forces
from ...sensing.built_cord import BuiltCord

#: Cords that are so many times as stiff as the body in their place are looked at.
STIFF = 2.0


def is_stiff(device: Device) -> bool:
    """Whether a cord is stiffer by far than the body that it takes the place of."""
    soft = device.material.young_modulus * device.channel_diameter**2
    return device.cord.modulus * device.cord.diameter**2 > STIFF * soft


def pulls(
    device: Device, locator: PointLocator, cords: Sequence[BuiltCord], error: float
) -> list[str]:
    """What is to be said where cords move the body at rest, with the regions fixed that the first
    pose fixes, by more than the `error` (mm) that is promised. Their pull is that of their
    pre-stretch, and the body's answer is linear. Raises nothing."""
    held = [c for c in cords if c.prestretch]
    if not held or not is_stiff(device):
        return []
    mesh, rod = locator.mesh, device.cord.modulus * np.pi / 4 * device.cord.diameter**2
    tension = [rod * (c.prestretch or 0.0) for c in held]
    fixed = _fixed(device, mesh)
    if fixed is None:
        return []
    forces = [line_forces(locator, c.path, t) for c, t in zip(held, tension, strict=True)]
    material = Material.from_spec(device.material)
    moves = displaced(mesh, material, fixed, np.sum(forces, axis=0))
    moved = float(np.linalg.norm(moves, axis=1).max())
    if moved <= error:
        return []
    return [
        f"the cord ({device.cord.modulus:g} MPa) is stiff beside {device.material.name}"
        f" ({device.material.young_modulus:.2g} MPa): stretched as they are laid, cords pull with"
        f" up to {max(tension):.1f} N, and move the body by about {moved:.1f} mm at rest, which is"
        " not in the simulation; training takes the rest as it finds it"
    ]


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
