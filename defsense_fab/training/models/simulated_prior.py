"""The states of a device's build as a prior for its training, with the cord's response of today."""

from __future__ import annotations

import igl
import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import TrainingError
from ...core.device.build_folder import finished_build
from ...geometry.bodies.body_record import load_surface
from ...geometry.bodies.meshing.mesh_file import load_mesh
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.solver.field_files import INDEX, load_fields
from ...sensing.built_cord import CordReading
from ...sensing.layout import LAYOUT, load_layout
from ..regression.simulation_prior import Prior

_OFF_BODY = 5.0  # mm: markers on printed tags lie above the skin, but not by more


def simulated_prior(device: Device, channels: tuple[str, ...], rest_points: Float) -> Prior:
    """Of the device's built layout for its `channels` and markers that are at rest at (m, 3) mm.
    Raises TrainingError for channels and markers that are not the device's."""
    folder = finished_build(device, LAYOUT, INDEX)
    fields = load_fields(folder)
    locator = PointLocator(QuadraticMesh.from_linear(load_mesh(folder)))
    cords = {
        record.name: record.built for record in load_layout(folder, TrainingError).by_channel()
    }
    if set(cords) != set(channels):
        raise TrainingError(
            f"{folder}: the device's cords are {', '.join(cords)}, the recordings' channels"
            f" {', '.join(channels)}: they are of another device or layout"
        )
    reading = CordReading.of(device)

    def moved(points: Float) -> Float:
        u = locator.displacement(locator.find(points), fields.displacements)
        return np.concatenate([np.zeros((1, *points.shape)), u])

    surface = load_surface(folder)
    square = igl.point_mesh_squared_distance(rest_points, surface.vertices, surface.faces)[0]
    off = np.where(locator.find(rest_points).depth < 0, np.sqrt(np.asarray(square)), 0.0)
    if (off > _OFF_BODY).any():
        k = int(off.argmax())
        raise TrainingError(
            f"marker {k + 1} at {np.round(rest_points[k], 1).tolist()} mm lies {off[k]:.0f} mm off"
            f" the body of {device.name}: the tracks are not in the device's rest frame, or of"
            " another device"
        )
    signals = [reading.signals(cords[n], cords[n].path + moved(cords[n].path)) for n in channels]
    return Prior(("rest", *fields.names), np.stack(signals, axis=1), moved(rest_points))
