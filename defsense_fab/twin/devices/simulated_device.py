"""The motion of a device as its build simulated it: surface, cords and points in every state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device.build_folder import finished_build
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.mesh import Surface
from ...sensing.built_cord import BuiltCord, CordReading
from ...store.build import Build
from ...store.fields import INDEX
from ...store.layout import LAYOUT
from ..scenes.device_motion import Ramp


@dataclass(frozen=True)
class SimulatedDevice:
    """A device with c cords in s simulated states.

    Attributes:
        rest: Surface at rest, n vertices, mm.
        skin: Displacements (s, n, 3) mm of the surface.
        ramps: The poses, with their levels and states.
        names: Names of the cords (c).
        cords: The cords as they are built in (c).
        moved: For each cord, the displacements (s, p, 3) mm of its stretched path.
        lengths: Lengths (c,) mm of cord with the resistances of the cords.
        shown: Displacements (s, m, 3) mm of the requested points.
    """

    rest: Surface
    skin: Float
    ramps: tuple[Ramp, ...]
    names: tuple[str, ...]
    cords: tuple[BuiltCord, ...]
    moved: tuple[Float, ...]
    lengths: Float
    shown: Float


def load_simulated_device(
    device: Device, points: Float, build: Build | None = None
) -> SimulatedDevice:
    """Load the motion of a device from its build.

    Args:
        device: The device.
        points: Points (m, 3) mm whose displacements are requested.
        build: Its build; by default that in its folder.

    Raises:
        CaptureError: The device is not built, or the build has no simulated pose (`no-poses`).
    """
    folder = finished_build(device, LAYOUT, INDEX)
    build = build or Build(folder)
    states = build.fields
    ramps = []
    for pose in device.poses:
        state_at = {
            weights[pose.name]: k
            for k, weights in enumerate(states.weights)
            if set(weights) == {pose.name} and 0 < weights[pose.name] <= 1
        }
        if state_at:
            levels = sorted(state_at)
            ramps.append(Ramp(pose.name, np.array(levels), np.array([state_at[x] for x in levels])))
    if not ramps:
        raise CaptureError(
            "contains no simulated pose",
            code="no-poses",
            where=folder,
            action="Build the device again",
        )
    locator = build.locator
    # The boundary of the tets bends where the body's own triangles, which may be long, do not.
    surface, _ = build.mesh.boundary().compact()

    def displacements(points: Float) -> Float:
        return locator.displacement(locator.find(points), states.displacements)

    records = build.layout.by_channel()
    cords = tuple(r.built for r in records)
    reading = CordReading.from_device(device)
    return SimulatedDevice(
        rest=surface,
        skin=displacements(surface.vertices),
        ramps=tuple(ramps),
        names=tuple(r.name for r in records),
        cords=cords,
        moved=tuple(displacements(c.path) for c in cords),
        lengths=np.array([reading.resistance(c) for c in cords]) / reading.ohm_per_mm,
        shown=displacements(points),
    )
