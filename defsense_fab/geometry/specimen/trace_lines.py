"""Place printed traces in calibration parts: their lines from pad to pad, for any section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.errors import FabricationError
from .specimen import Specimen

#: Between pads, and from pads to the edges of a coupon: a wall of an fdm printer and some.
PAD_SPACING_MM = 1.5


@dataclass(frozen=True)
class TraceLine:
    """Line of a trace in a part that is printed with z up.

    Attributes:
        name: Name of the trace.
        points: Points (p, 3) from skin to skin, mm.
        outward: Unit vectors (2, 3) out of the part at both ends.
        width: Width across the line, mm.
        height: Height along z, mm.
    """

    name: str
    points: Float
    outward: Float
    width: float
    height: float


def specimen_traces(s: Specimen, width: float, height: float, pad: float) -> list[TraceLine]:
    """Return the inner, neutral and outer trace of a specimen, with pads on its end faces.

    The end faces are strained least, and the end stops of the jigs leave them free in the middle.

    Args:
        s: The specimen, in its frame.
        width: Width of the traces, mm.
        height: Height of the traces, mm.
        pad: Diameter of the pads, mm.

    Raises:
        FabricationError: Traces or pads have no room.
    """
    needed = max(pad, height) + PAD_SPACING_MM
    if s.heights[1] - s.heights[0] < needed:
        least = float(np.ceil(2 * (s.offset + needed)))
        raise FabricationError(
            f"{s.thickness:g} mm cannot hold three traces whose pads measure {pad:g} mm",
            code="thickness-too-small",
            where="specimen",
            action=f"Give a thickness of {least:g} mm or more, or a smaller offset",
            least=least,
        )
    if s.width < width + 2 * PAD_SPACING_MM:
        raise FabricationError(
            f"a width of {s.width:g} mm cannot hold a trace {width:g} mm wide",
            code="specimen-too-small",
            where="specimen",
            action=f"Give a width of {width + 2 * PAD_SPACING_MM:g} mm or more",
        )
    return [
        straight_trace(name, (0.0, 0.0, z), (s.length, 0.0, z), width, height)
        for name, z in zip(("inner", "neutral", "outer"), s.heights, strict=True)
    ]


def straight_trace(
    name: str,
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    width: float,
    height: float,
) -> TraceLine:
    """Return a straight trace between two points of the skin, which is square to it there."""
    points = np.array([start, end])
    along = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
    return TraceLine(name, points, np.stack([-along, along]), width, height)
