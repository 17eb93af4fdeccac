"""Make the coupon of printed traces, whose resistances determine the filament's resistivities.

A block of rows side by side has a trace in each. Level traces of several lengths separate the
resistivity along beads from the resistance of the pads, and two upright ones add that between
layers. A wide trace shows whether resistance is inverse to the section, and a sloping one whether
the two resistivities predict traces that rise.

Rows run along x from 0, are stacked along y, and stand on z = 0. All traces meet the skin at right
angles, as their pads are discs of one size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import build123d as bd
import numpy as np

from ..kernels.occ import as_one_solid
from .specimen import make_lettering
from .trace_lines import PAD_SPACING_MM, TraceLine, straight_trace

#: Lengths of level traces, mm: the short one is mostly pads, in the long one they do not matter.
LONG_MM, MIDDLE_MM, SHORT_MM = 60.0, 30.0, 12.0
WIDE_LENGTH_MM, WIDE_FACTOR = 40.0, 2.0  # length of the wide trace; its width in usual widths
RISE_MM, STUB_MM = 10.0, 2.5  # of the sloping trace: height at 45 degrees; level ends
SLOPE = "slope"  # name of the sloping trace
LABEL_MM, ENGRAVING_DEPTH_MM = 4.0, 0.6  # size of the numbers on the rows


@dataclass(frozen=True)
class CouponRow:
    """A box of the coupon and the trace in it.

    Attributes:
        trace: The trace.
        low: Lowest corner (3,), mm.
        size: Size (3,), mm.
        label: Middle (3,) of the row's number on its upper face, mm.
    """

    trace: TraceLine
    low: tuple[float, float, float]
    size: tuple[float, float, float]
    label: tuple[float, float, float]


def coupon_rows(width: float, height: float, layer: float, pad: float) -> list[CouponRow]:
    """Return the rows of a coupon.

    Args:
        width: Width of the usual traces, mm.
        height: Height of the traces, mm.
        layer: Height of the printer's layers, mm; the undersides of level traces are on one.
        pad: Diameter of the pads, mm.
    """
    pitch = max(pad, WIDE_FACTOR * width) + 2 * PAD_SPACING_MM
    middle = max(pad, height) / 2 + PAD_SPACING_MM / 2
    low = float(np.ceil((middle - height / 2) / layer - 1e-9) * layer + height / 2)
    flat, tall = 2 * low, 2 * low + RISE_MM
    level = (
        ("long", LONG_MM, width),
        ("wide", WIDE_LENGTH_MM, WIDE_FACTOR * width),
        ("middle", MIDDLE_MM, width),
        ("short", SHORT_MM, width),
    )
    rows = []
    for n, (name, length, w) in enumerate(level):
        y = (n + 0.5) * pitch
        trace = straight_trace(name, (0.0, y, low), (length, y, low), w, height)
        box = ((0.0, n * pitch, 0.0), (length, pitch, flat))
        rows.append(CouponRow(trace, *box, (length / 2, y, flat)))
    length = RISE_MM + 2 * STUB_MM
    for n, (name, z) in enumerate((("upright-low", flat), ("upright", tall)), len(level)):
        x, y = length - pad / 2 - PAD_SPACING_MM, (n + 0.5) * pitch
        trace = straight_trace(name, (x, y, 0.0), (x, y, z), width, height)
        box = ((0.0, n * pitch, 0.0), (length, pitch, z))
        rows.append(CouponRow(trace, *box, ((x - pad / 2) / 2, y, z)))
    n, y = len(rows), (len(rows) + 0.5) * pitch
    corners = np.cumsum([0.0, STUB_MM, RISE_MM, STUB_MM])
    heights = (low, low, low + RISE_MM, low + RISE_MM)
    points = np.stack([corners, np.full(4, y), heights], axis=1)
    ends = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    slope = TraceLine(SLOPE, points, ends, width, height)
    box = ((0.0, n * pitch, 0.0), (length, pitch, tall))
    rows.append(CouponRow(slope, *box, (length / 2 - 1.0, y, tall)))
    return rows


def make_coupon_block(rows: list[CouponRow]) -> Any:
    """Return the block of a coupon (a TopoDS_Solid), with the rows' numbers from 1 engraved."""
    corner = (bd.Align.MIN,) * 3
    block, *others = [bd.Pos(*r.low) * bd.Box(*r.size, align=corner) for r in rows]
    block += others
    hollows = []
    for number, row in enumerate(rows, 1):
        x, y, z = row.label
        at = bd.Pos(x, y, z - ENGRAVING_DEPTH_MM)
        text = make_lettering(str(number), LABEL_MM)
        hollows.append(bd.extrude(at * text, amount=ENGRAVING_DEPTH_MM + 1))
    return as_one_solid(block - hollows)
