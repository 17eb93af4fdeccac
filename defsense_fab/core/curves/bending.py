"""Strain of a bar that lies on a rigid jig of known radius (DefSense, CHI 2016, Fig. 3)."""

from __future__ import annotations

#: Of the paper's nine jigs: radii of their surfaces, mm.
RADII = (75.0, 87.5, 100.0, 112.0, 150.0, 175.0, 200.0, 225.0, 250.0)


def bent_strain(radius: float, height: float, thickness: float) -> float:
    """Of a line `height` mm above a jig whose surface has this radius, mm, in a bar of this
    thickness, mm: its neutral plane lies at radius + thickness / 2 and keeps its length."""
    return (height - thickness / 2) / (radius + thickness / 2)
