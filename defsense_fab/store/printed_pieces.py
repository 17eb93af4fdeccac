"""What a piece adds to a print: its volume, and the layers in which the nozzle visits it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PrintedPiece:
    """A piece as it is printed.

    Attributes:
        volume: Volume, mm^3.
        height: Height on the bed, mm.
    """

    volume: float
    height: float
