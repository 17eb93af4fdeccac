"""Make the bending specimen, as OpenCascade solids.

DefSense (CHI 2016, Fig. 3): a bar with one cord near its top, one near its bottom and one in its
neutral plane lies on jigs of known radius. On a jig whose surface has radius r, the neutral plane
of a specimen of thickness h has radius r + h/2, and a cord at distance a from it the strain
a / (r + h/2).

The x axis runs along the specimen from 0; z across its thickness from 0, the side that lies on the
jig; and y across its width, 0 in the middle, where it is split so that the cords can be inserted.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import build123d as bd
import numpy as np

from ...core.errors import FabricationError
from ...core.response import (
    CORD_OFFSET_MM,
    SPECIMEN_LENGTH_MM,
    SPECIMEN_THICKNESS_MM,
    SPECIMEN_WIDTH_MM,
    bent_strain,
)
from ..kernels.occ import as_one_solid


def make_lettering(words: str, size: float) -> Any:
    """Return the outlines of words, as a build123d sketch centered on the origin.

    The font comes with the libraries, since systems have different fonts, or none.

    Args:
        words: The words.
        size: Size of the font, mm.
    """
    import matplotlib

    font = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    middle = (bd.Align.CENTER, bd.Align.CENTER)
    return bd.Text(words, font_size=size, font_path=str(font), align=middle)


CHAMFER_MM = 0.5  # of the channels' mouths
PIN_LENGTH_MM = 4.0
PIN_PLACES = (0.1, 0.5, 0.92)  # shares of the length; a half that is turned round does not fit


@dataclass(frozen=True)
class Specimen:
    """Sizes of a bending specimen.

    Attributes:
        length: Length, mm.
        thickness: Thickness, mm.
        width: Width, mm.
        offset: Distance of the outer cords from top and bottom, mm.
        channel_diameter: Diameter of the channels, mm.
        clearance: Clearance of pins in their sockets, on the diameter, mm.

    Raises:
        FabricationError: If such a specimen cannot be made.
    """

    length: float = SPECIMEN_LENGTH_MM
    thickness: float = SPECIMEN_THICKNESS_MM
    width: float = SPECIMEN_WIDTH_MM
    offset: float = CORD_OFFSET_MM
    channel_diameter: float = 2.2
    clearance: float = 0.2

    def __post_init__(self) -> None:
        """Check the sizes."""
        sizes = (self.length, self.thickness, self.width, self.offset, self.channel_diameter)
        if not all(np.isfinite(n) and 0 < n < 1000 for n in sizes):
            raise FabricationError(
                "its sizes must be above zero and below 1000 mm",
                code="out-of-range",
                where="specimen",
            )
        mouth = self.channel_diameter / 2 + CHAMFER_MM
        if self.offset < mouth:
            raise FabricationError(
                f"channels of {self.channel_diameter:g} mm at an offset of {self.offset:g} mm"
                f" break through the skin",
                code="offset-too-small",
                where="specimen",
                action=f"Give an offset of {mouth:.1f} mm or more",
                least=mouth,
            )
        if self.pin < 1.0:
            least = 2 * (self.offset + self.channel_diameter + 2.0)
            raise FabricationError(
                f"{self.thickness:g} mm cannot hold three channels with pins between them",
                code="thickness-too-small",
                where="specimen",
                action=f"Give a thickness of {least:.1f} mm or more, or a smaller offset",
                least=least,
            )
        if self.width < 2 * PIN_LENGTH_MM + 4 or self.length < 3 * self.thickness:
            raise FabricationError(
                f"{self.length:g} x {self.width:g} mm is too short or too narrow",
                code="specimen-too-small",
                where="specimen",
                action=f"Give {3 * self.thickness:g} x {2 * PIN_LENGTH_MM + 4:g} mm or more",
            )

    @property
    def heights(self) -> tuple[float, float, float]:
        """Heights of the inner, neutral and outer channel above the jig's surface, mm."""
        return self.offset, self.thickness / 2, self.thickness - self.offset

    @property
    def pin(self) -> float:
        """Diameter of the pins, which lie between two channels, mm."""
        between = self.thickness / 2 - self.offset - self.channel_diameter
        return min(between - 1.0, 3.0)

    def strain(self, radius: float, height: float) -> float:
        """Return the strain of a cord on a jig.

        Args:
            radius: Radius of the jig's surface, mm; infinite for a flat one.
            height: Height of the cord above it, mm.
        """
        return bent_strain(radius, height, self.thickness)

    def half_angle(self, radius: float) -> float:
        """Return half the angle that the specimen covers on a jig of a radius (mm), rad.

        Its neutral plane keeps its length.
        """
        return self.length / 2 / (radius + self.thickness / 2)


def make_whole(s: Specimen) -> Any:
    """Return a specimen in one piece, without channels (a TopoDS_Solid)."""
    corner = (bd.Align.MIN, bd.Align.CENTER, bd.Align.MIN)
    return as_one_solid(bd.Box(s.length, s.width, s.thickness, align=corner))


def make_halves(s: Specimen) -> dict[str, Any]:
    """Return both halves of a specimen (TopoDS_Solids by name); pins stand on the left one (y <
    0).
    """
    corner = (bd.Align.MIN, bd.Align.CENTER, bd.Align.MIN)
    whole = bd.Box(s.length, s.width, s.thickness, align=corner)
    upright = (bd.Align.CENTER, bd.Align.CENTER, bd.Align.MIN)
    radius = s.channel_diameter / 2
    for z in s.heights:
        tube = bd.Cylinder(radius, s.length + 2, align=upright)
        whole -= bd.Pos(-1, 0, z) * bd.Rot(0, 90, 0) * tube
        for x, turn in ((0.0, 90), (s.length, -90)):
            mouth = bd.Cone(
                radius + CHAMFER_MM,
                radius,
                CHAMFER_MM,
                align=upright,
            )
            whole -= bd.Pos(x, 0, z) * bd.Rot(0, turn, 0) * mouth
    left = whole & bd.Pos(0, -s.width / 2, 0) * bd.Box(s.length, s.width, s.thickness, align=corner)
    right = whole & bd.Pos(0, s.width / 2, 0) * bd.Box(s.length, s.width, s.thickness, align=corner)
    for n, share in enumerate(PIN_PLACES):
        low, high = s.heights[n % 2 : n % 2 + 2]
        at = bd.Pos(share * s.length, 0, (low + high) / 2) * bd.Rot(-90, 0, 0)
        left += at * bd.Cylinder(s.pin / 2, 2 * PIN_LENGTH_MM)
        right -= at * bd.Cylinder((s.pin + s.clearance) / 2, 2 * (PIN_LENGTH_MM + 0.5))
    return {"specimen-left": as_one_solid(left), "specimen-right": as_one_solid(right)}
