"""The record of a printed trace in `parts/manifest.json`."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.arrays import Float


@dataclass(frozen=True)
class TraceRecord:
    """A printed conductive trace.

    Attributes:
        name: Name.
        stl: STL file in the frame of the device.
        line: Its center line (p, 3) from pad to pad, mm.
        pads: Middles (2, 3) of the pads on the skin, mm.
        volume: Volume with the pads, mm^3.
        length: Length of the center line, mm.
        resistance: Resistance at rest, ohm.
        range: Lowest and highest resistance in use, ohm.
        reference_resistor: Reference resistor of the divider, ohm.
    """

    name: str
    stl: str
    line: Float
    pads: Float
    volume: float
    length: float
    resistance: float
    range: tuple[float, float]
    reference_resistor: float
