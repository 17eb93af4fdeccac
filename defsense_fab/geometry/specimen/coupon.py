"""The fit coupon: grooves for the cord and sockets for a peg over a range of clearances.

Two plates closed over a piece of cord, and a peg: the least clearance at which the cord still
slides and the peg goes in by hand is the printer's own, for this cord and material.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import build123d as bd

from ...core.errors import FabricationError
from ..kernels.occ import one_solid
from .specimen import lettering

PEG = 4.0  # mm, diameter of the peg
_DEPTH, _PLATE, _WIDTH, _BESIDE = 5.0, 8.0, 24.0, 4.0  # of sockets; of a plate; beside features
_SOCKET, _LABEL = 7.0, 17.0  # where they lie across the plate
_FONT, _ENGRAVED = 4.5, 0.6
_FLANGE, _ABOVE = 3.0, 0.9  # of the peg: its foot's width in diameters, what stands on it in depths


def sizes(cord: float, clearances: Sequence[float]) -> dict[str, tuple[float, float, float]]:
    """Width, depth and height (mm) of what `coupon` makes for the same arguments.

    Raises FabricationError for clearances that the plate does not hold.
    """
    most = 2 * (_PLATE - 2) - max(cord, PEG)
    if not clearances or min(clearances) < 0 or max(clearances) > most:
        raise FabricationError(
            f"coupon: clearances from 0 to {max(most, 0):g} mm are possible",
            code="clearance-out-of-range",
            most=max(most, 0.0),
        )
    length = 2 * _step(cord, clearances) * len(clearances) + _BESIDE
    return {
        "coupon-plate": (length, _WIDTH, _PLATE),
        "coupon-peg": (_FLANGE * PEG, _FLANGE * PEG, (1 + _ABOVE) * _DEPTH),
    }


def _step(cord: float, clearances: Sequence[float]) -> float:
    """From a groove to its socket, and on to the next groove, mm."""
    return (cord + PEG) / 2 + max(clearances) + _BESIDE


def coupon(cord: float, clearances: Sequence[float]) -> dict[str, Any]:
    """TopoDS_Solids: a plate with a groove of diameter cord + clearance, half of it, across it for
    every clearance (all on the diameter, mm), a socket and a label to the groove's right; and the
    peg. Of two such plates the second, turned over about x, closes the grooves of the first.

    x runs from one clearance to the next, the first groove at 0; grooves run along y.

    Raises FabricationError for clearances that the plate does not hold.
    """
    size, step = sizes(cord, clearances)["coupon-plate"], _step(cord, clearances)
    center = (bd.Align.CENTER,) * 3
    plate = bd.Pos(-step / 2 - _BESIDE / 2, 0, 0) * bd.Box(
        *size, align=(bd.Align.MIN, bd.Align.MIN, bd.Align.MAX)
    )
    hollows = []
    for n, clearance in enumerate(clearances):
        x = 2 * n * step
        tube = bd.Cylinder((cord + clearance) / 2, 3 * _WIDTH, align=center)
        hollows.append(bd.Pos(x, 0, 0) * bd.Rot(90, 0, 0) * tube)
        hole = bd.Cylinder((PEG + clearance) / 2, 2 * _DEPTH, align=center)
        hollows.append(bd.Pos(x + step, _SOCKET, 0) * hole)
        label = f"{clearance:.2f}".rstrip("0").rstrip(".")
        text = lettering(label, _FONT)
        at = bd.Pos(x + step, _LABEL, -_ENGRAVED)
        hollows.append(bd.extrude(at * text, amount=_ENGRAVED + 1))
    plate -= hollows  # one by one, each takes longer than the one before
    low = (bd.Align.CENTER, bd.Align.CENTER, bd.Align.MIN)
    peg = bd.Cylinder(_FLANGE * PEG / 2, _DEPTH, align=low)
    peg += bd.Pos(0, 0, _DEPTH) * bd.Cylinder(PEG / 2, _ABOVE * _DEPTH, align=low)
    return {"coupon-plate": one_solid(plate), "coupon-peg": one_solid(peg)}
