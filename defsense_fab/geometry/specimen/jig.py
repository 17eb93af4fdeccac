"""Make the rigid jigs on which the bending specimen is bent, as OpenCascade solids.

The y axis is that of the specimen; the axis of the jig's cylinder is at x = z = 0, with the
specimen on top.
"""

from __future__ import annotations

from typing import Any

import build123d as bd
import numpy as np

from ...core.errors import FabricationError
from ..kernels.occ import as_one_solid
from .specimen import Specimen, make_lettering

SHELL_DEPTH_MM, BASE_DEPTH_MM, FOOT_HEIGHT_MM = (
    10.0,
    20.0,
    8.0,
)  # depth under the specimen and at its ends; height of the foot
STOP_THICKNESS_MM, RAIL_PLAY_MM = 6.0, 0.4  # of end stops; between specimen and rails
RAIL_SIZE_MM = 3.0  # width and height of the rails along the specimen
MAX_HALF_ANGLE_RAD = np.radians(85)


def make_jig(s: Specimen, radius: float | None) -> Any:
    """Return a rigid jig (a TopoDS_Solid), which is printed lying on its side.

    It has end stops with gaps for the leads, rails along the specimen, and a window for straps that
    hold the specimen down.

    Args:
        s: The specimen.
        radius: Radius of the jig's surface, mm; None for a flat one.

    Raises:
        FabricationError: If the specimen would wrap too far around.
    """
    if (
        radius is not None
        and s.half_angle(radius) + (STOP_THICKNESS_MM + 2 * RAIL_PLAY_MM) / radius
        > MAX_HALF_ANGLE_RAD
    ):
        min_radius = (s.length / 2 + STOP_THICKNESS_MM + 2 * RAIL_PLAY_MM) / MAX_HALF_ANGLE_RAD
        raise FabricationError(
            f"a specimen of {s.length:g} mm wraps too far around a radius of {radius:g} mm",
            code="radius-too-small",
            where="jig",
            action=f"Give radii of {np.ceil(min_radius):g} mm or more, or a shorter specimen",
            min_radius=float(np.ceil(min_radius)),
        )
    inner = s.width + 2 * RAIL_PLAY_MM
    outer = inner + 2 * RAIL_SIZE_MM
    solid = _prism(_outline(s, radius), outer)
    rails = _prism(_strip(s, radius, 0.0, RAIL_SIZE_MM, stops=False), outer)
    solid += rails - _prism(_strip(s, radius, -1.0, RAIL_SIZE_MM + 1.0, stops=False), inner)
    stops = _prism(_strip(s, radius, 0.0, 0.6 * s.thickness, stops=True), outer)
    solid += stops - _prism(
        _strip(s, radius, -1.0, s.thickness, stops=False), 2 * s.channel_diameter + 4
    )
    name = "FLAT" if radius is None else f"R{radius:g}"
    text = make_lettering(name, 6.0)
    at = bd.Plane(
        origin=(0, -outer / 2, (radius or 0.0) - SHELL_DEPTH_MM / 2),
        x_dir=(1, 0, 0),
        z_dir=(0, -1, 0),
    )
    solid -= bd.extrude(at * text, amount=-0.6)
    return as_one_solid(solid)


def _outline(s: Specimen, radius: float | None) -> Any:
    """Return the outline of a jig with its window, in the plane of x and z."""
    half_length = s.length / 2 + STOP_THICKNESS_MM + 2 * RAIL_PLAY_MM
    if radius is None:
        face = bd.Pos(0, -BASE_DEPTH_MM / 2) * bd.Rectangle(2 * half_length, BASE_DEPTH_MM)
        low, high = -BASE_DEPTH_MM + FOOT_HEIGHT_MM - 2, -SHELL_DEPTH_MM + 2
        return face - bd.Pos(0, (low + high) / 2) * bd.Rectangle(2 * half_length - 30, high - low)
    angle = s.half_angle(radius) + (STOP_THICKNESS_MM + 2 * RAIL_PLAY_MM) / radius
    x, z = radius * np.sin(angle), radius * np.cos(angle)
    low = z - BASE_DEPTH_MM
    arc = bd.ThreePointArc((-x, z), (0, radius), (x, z))
    face = bd.make_face([arc, bd.Polyline((x, z), (x, low), (-x, low), (-x, z))])
    half = np.sqrt((radius - SHELL_DEPTH_MM) ** 2 - (low + FOOT_HEIGHT_MM) ** 2)
    window = bd.Circle(radius - SHELL_DEPTH_MM) & bd.Pos(0, low + FOOT_HEIGHT_MM) * bd.Rectangle(
        2 * min(half, x - SHELL_DEPTH_MM), 2 * radius, align=(bd.Align.CENTER, bd.Align.MIN)
    )
    return face - window


def _strip(s: Specimen, radius: float | None, low: float, high: float, *, stops: bool) -> Any:
    """Return the strip `low` to `high` mm above the jig's surface, in the plane of x and z: along
    all of it, or only where the end stops are.
    """
    outer_half = s.length / 2 + STOP_THICKNESS_MM + 2 * RAIL_PLAY_MM
    inner_half = s.length / 2 + RAIL_PLAY_MM
    if radius is None:
        face = bd.Pos(0, (low + high) / 2) * bd.Rectangle(2 * outer_half, high - low)
        return (
            face - bd.Pos(0, (low + high) / 2) * bd.Rectangle(2 * inner_half, 9 * s.thickness)
            if stops
            else face
        )
    face = _sector(s.half_angle(radius) + (outer_half - s.length / 2) / radius, radius + high)
    face -= bd.Circle(radius + low)
    if stops:
        face -= _sector(s.half_angle(radius) + RAIL_PLAY_MM / radius, radius + 9 * s.thickness)
    return face


def _sector(angle: float, radius: float) -> Any:
    """Return a sector of a circle, `angle` rad to both sides of the z axis."""
    x, z = radius * np.sin(angle), radius * np.cos(angle)
    arc = bd.ThreePointArc((-x, z), (0, radius), (x, z))
    return bd.make_face([arc, bd.Polyline((x, z), (0, 0), (-x, z))])


def _prism(face: Any, width: float) -> Any:
    """Return a face in the plane of x and z, extruded to both sides."""
    upright = bd.Plane(origin=(0, 0, 0), x_dir=(1, 0, 0), z_dir=(0, -1, 0))
    return bd.extrude(upright * face, amount=width / 2, both=True)
