"""What a build knows of how its device moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.mesh import Surface
from ...core.storage.build_folder import finished_build
from ...geometry.bodies.meshing.mesh_file import load_mesh
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.solver.field_files import INDEX, load_fields
from ...sensing.built_cord import BuiltCord, CordReading
from ...sensing.layout import LAYOUT, load_layout
from ..scenes.device_motion import Ramp


@dataclass(frozen=True)
class SimulatedDevice:
    """`rest` surface, displacements `skin` (s, n, 3) mm, `ramps` of its poses; cords by name, as
    they are built in, displacements (s, p, 3) mm of their stretched paths, and the `lengths` that
    have their resistances, mm; displacements `shown` (s, m, 3) mm of the points asked for."""

    rest: Surface
    skin: Float
    ramps: tuple[Ramp, ...]
    names: tuple[str, ...]
    cords: tuple[BuiltCord, ...]
    moved: tuple[Float, ...]
    lengths: Float
    shown: Float


def simulated_device(device: Device, points: Float) -> SimulatedDevice:
    """From the device's build, with what points (m, 3) mm do. Raises CaptureError where it has no
    build, or no pose in it."""
    folder = finished_build(device, LAYOUT, INDEX)
    found = load_fields(folder)
    fields = found.displacements
    ramps = []
    for pose in device.poses:
        levels = {
            weights[pose.name]: k
            for k, weights in enumerate(found.weights)
            if set(weights) == {pose.name} and 0 < weights[pose.name] <= 1
        }
        if levels:
            order = sorted(levels)
            ramps.append(Ramp(pose.name, np.array(order), np.array([levels[x] for x in order])))
    if not ramps:
        raise CaptureError(f"{folder}: holds no simulated pose; build the device again")
    mesh = load_mesh(folder)
    locator = PointLocator(QuadraticMesh.from_linear(mesh))
    # The tets' boundary bends where a body's own triangles, which may be long, do not.
    surface, _ = mesh.boundary().compact()

    def at(where: Float) -> Float:
        return locator.displacement(locator.find(where), fields)

    records = load_layout(folder).by_channel()
    cords = tuple(r.built for r in records)
    reading = CordReading.of(device)
    lengths = np.array([reading.resistance(c) for c in cords]) / reading.ohm_per_mm
    return SimulatedDevice(
        surface, at(surface.vertices), tuple(ramps), tuple(r.name for r in records), cords,
        tuple(at(c.path) for c in cords), lengths, at(points),
    )  # fmt: skip
