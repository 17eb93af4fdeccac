"""The places that a device is designed to tell, as if tags were glued there."""

from __future__ import annotations

from pathlib import Path

import igl
import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.markers import Markers
from ...geometry.bodies.body_record import load_surface
from ...sensing.layout import load_prediction

_SIZES = (50, 100, 250, 1000)  # of the dictionaries of 4 x 4 tags


def design_markers(device: Device, folder: Path) -> Markers:
    """Numbered from 0, upright on the skin. Raises CaptureError for more than can be numbered."""
    centers = load_prediction(folder).markers
    family = next((n for n in _SIZES if n >= len(centers)), None)
    if family is None:
        raise CaptureError(
            f"{device.source}: has {len(centers)} markers; a twin shows {_SIZES[-1]} at most: give"
            " tags with --markers, or a number of [outputs] markers"
        )
    surface = load_surface(folder)
    _, face, _ = igl.point_mesh_squared_distance(centers, surface.vertices, surface.faces)[:3]
    a, b, c = np.moveaxis(surface.vertices[surface.faces[face]], 1, 0)
    anchor = device.outputs.anchor
    held = device.regions[anchor].contains(centers) if anchor else np.zeros(len(centers), bool)
    return Markers(
        device.name, f"4X4_{family}", device.fabrication.marker_size, np.arange(len(centers)),
        centers, _axes(np.cross(b - a, c - a)), held,
    )  # fmt: skip


def _axes(normals: Float) -> Float:
    """(m, 3, 3) of normals (m, 3) of any length."""
    z = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    across = np.eye(3)[np.abs(z).argmin(axis=1)]
    x = np.cross(across, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)
