"""Make the fit coupon: grooves for the cord and sockets for a peg over a range of clearances.

It consists of two plates that close over a piece of cord, and a peg. The least clearance at which
the cord still slides and the peg can be pushed in is that of the printer, for this cord and
material.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import build123d as bd

from ...core.errors import FabricationError
from ..kernels.occ import as_one_solid
from .specimen import make_lettering

PEG_DIAMETER_MM = 4.0  # of the peg
SOCKET_DEPTH_MM, PLATE_THICKNESS_MM, PLATE_WIDTH_MM, SPACING_MM = (
    5.0,
    8.0,
    24.0,
    4.0,
)  # of sockets; of a plate; next to features
SOCKET_Y_MM, LABEL_Y_MM = 7.0, 17.0  # positions across the plate
FONT_SIZE_MM, ENGRAVING_DEPTH_MM = 4.5, 0.6
FLANGE_DIAMETERS, PEG_HEIGHT_DEPTHS = (
    3.0,
    0.9,
)  # of the peg: width of its foot; height above it in socket depths


def coupon_sizes(cord: float, clearances: Sequence[float]) -> dict[str, tuple[float, float, float]]:
    """Return width, depth and height of the solids of `make_coupon` for the same arguments, mm.

    Raises:
        FabricationError: If the plate cannot hold these clearances.
    """
    largest = 2 * (PLATE_THICKNESS_MM - 2) - max(cord, PEG_DIAMETER_MM)
    if not clearances or min(clearances) < 0 or max(clearances) > largest:
        raise FabricationError(
            f"clearances from 0 to {max(largest, 0):g} mm are possible",
            code="out-of-range",
            where="coupon",
            most=max(largest, 0.0),
        )
    length = 2 * _step(cord, clearances) * len(clearances) + SPACING_MM
    return {
        "coupon-plate": (length, PLATE_WIDTH_MM, PLATE_THICKNESS_MM),
        "coupon-peg": (
            FLANGE_DIAMETERS * PEG_DIAMETER_MM,
            FLANGE_DIAMETERS * PEG_DIAMETER_MM,
            (1 + PEG_HEIGHT_DEPTHS) * SOCKET_DEPTH_MM,
        ),
    }


def _step(cord: float, clearances: Sequence[float]) -> float:
    """Return the distance from a groove to its socket, and on to the next groove, mm."""
    return (cord + PEG_DIAMETER_MM) / 2 + max(clearances) + SPACING_MM


def make_coupon(cord: float, clearances: Sequence[float]) -> dict[str, Any]:
    """Return the plate and the peg of a fit coupon (TopoDS_Solids by name).

    For every clearance the plate has half a groove of diameter cord + clearance across it, and to
    its right a socket and a label. A second plate, turned over about x, closes the grooves of the
    first. x runs from one clearance to the next, with the first groove at 0; grooves run along y.

    Args:
        cord: Diameter of the cord, mm.
        clearances: Clearances on the diameter, mm.

    Raises:
        FabricationError: If the plate cannot hold these clearances.
    """
    size, step = coupon_sizes(cord, clearances)["coupon-plate"], _step(cord, clearances)
    center = (bd.Align.CENTER,) * 3
    plate = bd.Pos(-step / 2 - SPACING_MM / 2, 0, 0) * bd.Box(
        *size, align=(bd.Align.MIN, bd.Align.MIN, bd.Align.MAX)
    )
    hollows = []
    for n, clearance in enumerate(clearances):
        x = 2 * n * step
        tube = bd.Cylinder((cord + clearance) / 2, 3 * PLATE_WIDTH_MM, align=center)
        hollows.append(bd.Pos(x, 0, 0) * bd.Rot(90, 0, 0) * tube)
        hole = bd.Cylinder((PEG_DIAMETER_MM + clearance) / 2, 2 * SOCKET_DEPTH_MM, align=center)
        hollows.append(bd.Pos(x + step, SOCKET_Y_MM, 0) * hole)
        label = f"{clearance:.2f}".rstrip("0").rstrip(".")
        text = make_lettering(label, FONT_SIZE_MM)
        at = bd.Pos(x + step, LABEL_Y_MM, -ENGRAVING_DEPTH_MM)
        hollows.append(bd.extrude(at * text, amount=ENGRAVING_DEPTH_MM + 1))
    plate -= hollows  # one by one, each cut would take longer than the previous one
    low = (bd.Align.CENTER, bd.Align.CENTER, bd.Align.MIN)
    peg = bd.Cylinder(FLANGE_DIAMETERS * PEG_DIAMETER_MM / 2, SOCKET_DEPTH_MM, align=low)
    peg += bd.Pos(0, 0, SOCKET_DEPTH_MM) * bd.Cylinder(
        PEG_DIAMETER_MM / 2, PEG_HEIGHT_DEPTHS * SOCKET_DEPTH_MM, align=low
    )
    return {"coupon-plate": as_one_solid(plate), "coupon-peg": as_one_solid(peg)}
