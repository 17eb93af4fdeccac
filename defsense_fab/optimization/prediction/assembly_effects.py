"""Check the effects of assembly: cords that open joints stretch, and cords that deform the body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Int
from ...core.device.device import Device
from ...core.errors import DeviceError
from ...core.progress import Notice
from ...geometry.channels import cord_assembly
from ...geometry.parts.records import PartSet
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.loading.boundary_conditions import BoundaryConditions
from ...mechanics.loading.constraint_check import check_constraints
from ...mechanics.solver.linear_response import line_forces, small_load_displacement
from ...mechanics.solver.linear_solver import NotPositiveDefinite
from ...sensing.built_cord import BuiltCord
from .design_task import DesignTask

MIN_JOINT_OPENING_MM = 15.0  # by which a joint is opened for work in it
#: Pre-stretch of most held cords, assumed while it is unknown; `find_overstretched_cords` warns of
#: cords that are stretched more.
_ASSUMED_PRESTRETCH = 0.1


def min_length_across_joint(device: Device) -> float:
    """Return the length (mm) between ferrules from which a cord survives an open joint.

    The cord passes through the joint and is held at both ends.
    """
    f = device.fabrication
    assumed = _ASSUMED_PRESTRETCH if f.prestretch is None else f.prestretch
    prestretch = 0.0 if f.assembly == "bonded" else assumed
    spare = device.cord.max_strain - prestretch
    return (1 + prestretch) * MIN_JOINT_OPENING_MM / spare if spare > 0 else float("inf")


def find_overstretched_cords(
    device: Device, parts: PartSet, cords: Sequence[BuiltCord]
) -> list[Notice]:
    """Find cords that assembly stretches beyond their limit.

    Cords that lie in several joints are inserted while these are closed one after the other. A
    joint that is still open stretches them, and so does an end that can only be crimped, outside of
    its mouth, after the joints are closed.

    Args:
        device: The device.
        parts: Its parts.
        cords: Its cords as built in, one for each channel of the parts.
    """
    max_strain, ferrule = device.cord.max_strain, device.cord.ferrule_length
    out = []
    for k, (channel, cord) in enumerate(zip(parts.channels, cords, strict=True)):
        if sum(k in c.cords and k not in c.wires for c in parts.cuts) < 2:
            continue
        between = cord.length + cord.series
        unstretched = cord.length / (1 + (cord.prestretch or 0.0)) + cord.series
        lead = device.fabrication.lead
        crimping = [
            cord_assembly.crimping_strain(
                between, unstretched, e.pocket, ferrule, 0.0 if e.pocket else lead
            )
            for e in channel.ends
            if e.wire in ("mouth", "outside")
        ]
        strain = min(crimping, default=(between + MIN_JOINT_OPENING_MM) / unstretched - 1)
        if strain > max_strain:
            code, cause = "cord-short-for-crimping", "to crimp its last end outside of its mouth"
            if not crimping:
                code = "cord-short-in-open-joint"
                cause = f"while one of them is open by {MIN_JOINT_OPENING_MM:.0f} mm"
            message = (
                f"cord {channel.name} is short and lies in several joints: {cause}, it is stretched"
                f" by {strain:.0%}, more than its limit of {max_strain:.0%}. Make it longer, or"
                " move its plane or those that it passes through"
            )
            out.append(Notice(code, message, channel.name, {"strain": float(strain)}))
    return out


def check_cord_pull(
    device: Device, task: DesignTask, cords: Sequence[BuiltCord], error: float
) -> list[Notice]:
    """Check whether held cords, which are stretched during assembly, deform the body at rest.

    The first pose's fixed regions are held, cords pull by their pre-stretch, and the body responds
    linearly. Nothing is checked if these regions do not hold the body, or its matrix needs too much
    memory.

    Args:
        device: The device.
        task: Its design task.
        cords: Its cords as built in.
        error: Predicted RMSE, mm. There is a note if the markers move by more (root mean square).
    """
    taut = [(c.path, _axial_stiffness(device) * c.prestretch) for c in cords if c.prestretch]
    locator = task.everything.locator
    if not taut or (fixed := _fixed_nodes(device, locator.mesh)) is None:
        return []
    forces = np.sum([line_forces(locator, path, tension) for path, tension in taut], axis=0)
    try:
        u = small_load_displacement(
            locator.mesh, Material.from_spec(device.material), fixed, forces
        )
    except (NotPositiveDefinite, MemoryError):  # a note is not worth failing a build
        return []
    moved = locator.displacement(locator.find(task.points), u[None])[0]
    rms = float(np.sqrt((moved**2).sum(axis=1) @ task.everything.marker_weights))
    if rms <= error:
        return []
    tension = max(t for _, t in taut)
    message = (
        f"cords stretched during assembly pull with up to {tension:.2g} N and move the surface by"
        f" about {rms:.2g} mm (root mean square) at rest: cords of {device.cord.modulus:g} MPa in"
        f" {device.material.name} of {device.material.young_modulus:.2g} MPa. The simulation"
        " ignores this; training measures the shape at rest"
    )
    values = {"tension": float(tension), "displacement": rms}
    return [Notice("cords-deform-body", message, data=values)]


def _axial_stiffness(device: Device) -> float:
    """Return a cord's tension divided by its strain, N."""
    return device.cord.modulus * np.pi / 4 * device.cord.diameter**2


def _fixed_nodes(device: Device, mesh: QuadraticMesh) -> Int | None:
    """Return the nodes that the first pose fixes, or None if these alone do not hold the body."""
    regions = next((p.fixed for p in device.poses if p.fixed), ())
    inside = [device.regions[r].contains(mesh.nodes) for r in regions]
    fixed = np.flatnonzero(np.any(inside, axis=0)) if inside else np.zeros(0, int)
    try:
        check_constraints(mesh, BoundaryConditions(fixed), "rest")
    except DeviceError:
        return None
    return fixed
