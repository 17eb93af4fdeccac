"""The bending specimen and the rigid jigs that it is bent on, as OpenCascade solids.

DefSense (CHI 2016, Fig. 3): a bar with one cord near its top, one near its bottom and one in its
neutral plane lies on jigs of known radius. On a jig whose surface has radius r the neutral plane of
a specimen of thickness h has radius r + h/2, and a cord at distance a from it the strain
a / (r + h/2).

Specimen: x along its length from 0, z across its thickness from 0 (the side that lies on the jig),
y across its width, 0 in the middle, where it is split so that the cords can be laid in. Jigs: y the
same, the axis of their cylinder at x = z = 0, the specimen on top.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import build123d as bd
import numpy as np

from ...core.errors import FabricationError
from ...core.response import bent_strain
from ..kernels.occ import one_solid

# Words on what is printed, in a font that comes with the libraries: systems have different ones,
# or none.


def lettering(words: str, size: float) -> Any:
    """The outlines of words, as a build123d sketch centred on the origin; `size` in mm."""
    import matplotlib

    font = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    middle = (bd.Align.CENTER, bd.Align.CENTER)
    return bd.Text(words, font_size=size, font_path=str(font), align=middle)


_CHAMFER = 0.5  # mm, of the channels' mouths
_PIN_LENGTH = 4.0
_PINS = (0.1, 0.5, 0.92)  # of the length: a half that is turned round does not fit
_SHELL, _BASE, _FOOT = 10.0, 20.0, 8.0  # a jig's depth under the specimen, at its ends, its foot
_STOP, _PLAY = 6.0, 0.4  # thickness of end stops and rails' distance, mm
_RAIL = 3.0  # width and height of the rails along the specimen
_STEEPEST = np.radians(85)


@dataclass(frozen=True)
class Specimen:
    """All mm; `offset` is the outer cords' distance from top and bottom, `clearance` that of
    pins in their sockets, on the diameter."""

    length: float = 150.0
    thickness: float = 15.0
    width: float = 20.0
    offset: float = 2.0
    channel_diameter: float = 2.2
    clearance: float = 0.2

    def __post_init__(self) -> None:
        """Raises FabricationError for a specimen that cannot be."""
        sizes = (self.length, self.thickness, self.width, self.offset, self.channel_diameter)
        if not all(np.isfinite(n) and 0 < n < 1000 for n in sizes):
            raise FabricationError(
                "specimen: its sizes must be above zero and below 1000 mm", code="size-out-of-range"
            )
        mouth = self.channel_diameter / 2 + _CHAMFER
        if self.offset < mouth:
            raise FabricationError(
                f"specimen: channels of {self.channel_diameter:g} mm at an offset of"
                f" {self.offset:g} mm break through the skin; give an offset of {mouth:.1f} mm"
                " or more",
                code="offset-too-small",
                least=mouth,
            )
        if self.pin < 1.0:
            least = 2 * (self.offset + self.channel_diameter + 2.0)
            raise FabricationError(
                f"specimen: {self.thickness:g} mm hold no three channels with pins between them;"
                f" give a thickness of {least:.1f} mm or more, or a smaller offset",
                code="thickness-too-small",
                least=least,
            )
        if self.width < 2 * _PIN_LENGTH + 4 or self.length < 3 * self.thickness:
            raise FabricationError(
                f"specimen: {self.length:g} x {self.width:g} mm is too short or too narrow; give"
                f" {3 * self.thickness:g} x {2 * _PIN_LENGTH + 4:g} mm or more",
                code="specimen-too-small",
            )

    @property
    def heights(self) -> tuple[float, float, float]:
        """Of the three channels above the jig's surface: inner, neutral, outer."""
        return self.offset, self.thickness / 2, self.thickness - self.offset

    @property
    def pin(self) -> float:
        """Diameter of the pins, which lie between two channels."""
        between = self.thickness / 2 - self.offset - self.channel_diameter
        return min(between - 1.0, 3.0)

    def strain(self, radius: float, height: float) -> float:
        """Of a cord at so many mm above the surface of a jig of this radius; 0 on a flat one."""
        return bent_strain(radius, height, self.thickness)

    def half_angle(self, radius: float) -> float:
        """Half the angle, rad, that the specimen covers on a jig: its neutral plane keeps its
        length."""
        return self.length / 2 / (radius + self.thickness / 2)


def halves(s: Specimen) -> dict[str, Any]:
    """Both halves of the specimen, TopoDS_Solids; pins stand on the left one (y < 0)."""
    corner = (bd.Align.MIN, bd.Align.CENTER, bd.Align.MIN)
    whole = bd.Box(s.length, s.width, s.thickness, align=corner)
    radius = s.channel_diameter / 2
    for z in s.heights:
        whole -= _along_x(radius, s.length, 0.0, z)
        for x, turn in ((0.0, 90), (s.length, -90)):
            mouth = bd.Cone(
                radius + _CHAMFER, radius, _CHAMFER,
                align=(bd.Align.CENTER, bd.Align.CENTER, bd.Align.MIN),
            )  # fmt: skip
            whole -= bd.Pos(x, 0, z) * bd.Rot(0, turn, 0) * mouth
    left = whole & bd.Pos(0, -s.width / 2, 0) * bd.Box(s.length, s.width, s.thickness, align=corner)
    right = whole & bd.Pos(0, s.width / 2, 0) * bd.Box(s.length, s.width, s.thickness, align=corner)
    for n, share in enumerate(_PINS):
        low, high = s.heights[n % 2 : n % 2 + 2]
        at = bd.Pos(share * s.length, 0, (low + high) / 2) * bd.Rot(-90, 0, 0)
        left += at * bd.Cylinder(s.pin / 2, 2 * _PIN_LENGTH)
        right -= at * bd.Cylinder((s.pin + s.clearance) / 2, 2 * (_PIN_LENGTH + 0.5))
    return {"specimen-left": one_solid(left), "specimen-right": one_solid(right)}


def jig(s: Specimen, radius: float | None) -> Any:
    """The rigid jig of this surface radius, mm, or without one the flat one, a TopoDS_Solid: end
    stops with gaps for the leads, rails along the specimen, and a window for straps that hold it
    down. It is printed lying on its side.

    Raises FabricationError where the specimen would wrap too far around.
    """
    if radius is not None and s.half_angle(radius) + (_STOP + 2 * _PLAY) / radius > _STEEPEST:
        least = (s.length / 2 + _STOP + 2 * _PLAY) / _STEEPEST
        raise FabricationError(
            f"jig: a specimen of {s.length:g} mm wraps too far around a radius of {radius:g} mm;"
            f" give radii of {np.ceil(least):g} mm or more, or a shorter specimen",
            code="radius-too-small",
            least=float(np.ceil(least)),
        )
    inner = s.width + 2 * _PLAY
    outer = inner + 2 * _RAIL
    solid = _prism(_frame(s, radius), outer)
    rails = _prism(_strip(s, radius, 0.0, _RAIL, stops=False), outer)
    solid += rails - _prism(_strip(s, radius, -1.0, _RAIL + 1.0, stops=False), inner)
    stops = _prism(_strip(s, radius, 0.0, 0.6 * s.thickness, stops=True), outer)
    solid += stops - _prism(
        _strip(s, radius, -1.0, s.thickness, stops=False), 2 * s.channel_diameter + 4
    )
    name = "FLAT" if radius is None else f"R{radius:g}"
    text = lettering(name, 6.0)
    at = bd.Plane(
        origin=(0, -outer / 2, (radius or 0.0) - _SHELL / 2), x_dir=(1, 0, 0), z_dir=(0, -1, 0)
    )
    solid -= bd.extrude(at * text, amount=-0.6)
    return one_solid(solid)


def _frame(s: Specimen, radius: float | None) -> Any:
    """Outline of a jig with its window, in the plane of x and z."""
    far = s.length / 2 + _STOP + 2 * _PLAY
    if radius is None:
        face = bd.Pos(0, -_BASE / 2) * bd.Rectangle(2 * far, _BASE)
        low, high = -_BASE + _FOOT - 2, -_SHELL + 2
        return face - bd.Pos(0, (low + high) / 2) * bd.Rectangle(2 * far - 30, high - low)
    angle = s.half_angle(radius) + (_STOP + 2 * _PLAY) / radius
    x, z = radius * np.sin(angle), radius * np.cos(angle)
    low = z - _BASE
    arc = bd.ThreePointArc((-x, z), (0, radius), (x, z))
    face = bd.make_face([arc, bd.Polyline((x, z), (x, low), (-x, low), (-x, z))])
    half = np.sqrt((radius - _SHELL) ** 2 - (low + _FOOT) ** 2)
    window = bd.Circle(radius - _SHELL) & bd.Pos(0, low + _FOOT) * bd.Rectangle(
        2 * min(half, x - _SHELL), 2 * radius, align=(bd.Align.CENTER, bd.Align.MIN)
    )
    return face - window


def _strip(s: Specimen, radius: float | None, low: float, high: float, *, stops: bool) -> Any:
    """What lies `low` to `high` mm above the jig's surface, in the plane of x and z: along all of
    it, or only where the end stops are."""
    far = s.length / 2 + _STOP + 2 * _PLAY
    near = s.length / 2 + _PLAY
    if radius is None:
        face = bd.Pos(0, (low + high) / 2) * bd.Rectangle(2 * far, high - low)
        return (
            face - bd.Pos(0, (low + high) / 2) * bd.Rectangle(2 * near, 9 * s.thickness)
            if (stops)
            else face
        )
    face = _sector(s.half_angle(radius) + (far - s.length / 2) / radius, radius + high)
    face -= bd.Circle(radius + low)
    if stops:
        face -= _sector(s.half_angle(radius) + _PLAY / radius, radius + 9 * s.thickness)
    return face


def _sector(angle: float, radius: float) -> Any:
    """Of a circle, `angle` rad to both sides of the z axis."""
    x, z = radius * np.sin(angle), radius * np.cos(angle)
    arc = bd.ThreePointArc((-x, z), (0, radius), (x, z))
    return bd.make_face([arc, bd.Polyline((x, z), (0, 0), (-x, z))])


def _prism(face: Any, width: float) -> Any:
    """The face in the plane of x and z, extruded to both sides."""
    upright = bd.Plane(origin=(0, 0, 0), x_dir=(1, 0, 0), z_dir=(0, -1, 0))
    return bd.extrude(upright * face, amount=width / 2, both=True)


def _along_x(radius: float, length: float, y: float, z: float) -> Any:
    tube = bd.Cylinder(radius, length + 2, align=(bd.Align.CENTER, bd.Align.CENTER, bd.Align.MIN))
    return bd.Pos(-1, y, z) * bd.Rot(0, 90, 0) * tube
