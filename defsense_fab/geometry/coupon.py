"""The fit coupon: grooves for the cord and sockets for a peg over a range of clearances.

Two plates closed over a piece of cord, and a peg: the least clearance at which the cord still
slides and the peg goes in by hand is the printer's own, for this cord and material.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import build123d as bd

from ..core.errors import FabricationError
from .occ import one_solid

PEG = 4.0  # mm, diameter of the peg
_DEPTH, _PLATE, _WIDTH, _BESIDE = 5.0, 8.0, 24.0, 4.0  # of sockets; of a plate; beside features
_SOCKET, _LABEL = 7.0, 17.0  # where they lie across the plate
_FONT, _ENGRAVED = 4.5, 0.6


def coupon(cord: float, clearances: Sequence[float]) -> dict[str, Any]:
    """TopoDS_Solids: a plate with a groove of diameter cord + clearance, half of it, across it for
    every clearance (all on the diameter, mm), a socket and a label to the groove's right; and the
    peg. Of two such plates the second, turned over about x, closes the grooves of the first.

    x runs from one clearance to the next, the first groove at 0; grooves run along y.

    Raises FabricationError for clearances that the plate does not hold.
    """
    most = 2 * (_PLATE - 2) - max(cord, PEG)
    if not clearances or min(clearances) < 0 or max(clearances) > most:
        raise FabricationError(f"coupon: clearances from 0 to {max(most, 0):g} mm are possible")
    groove, socket = cord + max(clearances), PEG + max(clearances)
    step = (groove + socket) / 2 + _BESIDE  # from a groove to its socket, and on to the next groove
    center = (bd.Align.CENTER,) * 3
    length = 2 * step * len(clearances) + _BESIDE
    plate = bd.Pos(-step / 2 - _BESIDE / 2, 0, 0) * bd.Box(
        length, _WIDTH, _PLATE, align=(bd.Align.MIN, bd.Align.MIN, bd.Align.MAX)
    )
    for n, clearance in enumerate(clearances):
        x = 2 * n * step
        tube = bd.Cylinder((cord + clearance) / 2, 3 * _WIDTH, align=center)
        plate -= bd.Pos(x, 0, 0) * bd.Rot(90, 0, 0) * tube
        hole = bd.Cylinder((PEG + clearance) / 2, 2 * _DEPTH, align=center)
        plate -= bd.Pos(x + step, _SOCKET, 0) * hole
        label = f"{clearance:.2f}".rstrip("0").rstrip(".")
        text = bd.Text(label, font_size=_FONT, align=center[:2])
        plate -= bd.extrude(bd.Pos(x + step, _LABEL, -_ENGRAVED) * text, amount=_ENGRAVED + 1)
    low = (bd.Align.CENTER, bd.Align.CENTER, bd.Align.MIN)
    peg = bd.Cylinder(PEG * 1.5, _DEPTH, align=low)
    peg += bd.Pos(0, 0, _DEPTH) * bd.Cylinder(PEG / 2, 0.9 * _DEPTH, align=low)
    return {"coupon-plate": one_solid(plate), "coupon-peg": one_solid(peg)}
