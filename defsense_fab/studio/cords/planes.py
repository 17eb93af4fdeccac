"""Planes to draw on: the body's middle ones, and those of cords."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.curve import Plane
from ...core.device.device import Sensor
from ...core.mesh import Surface

_AXES = "xyz"


def planes(surface: Surface, sensors: Sequence[Sensor]) -> dict[str, Plane]:
    """By what they are called: across the body's thin side first, each with its x axis along the
    body."""
    v = surface.vertices
    middle, extent = (v.min(0) + v.max(0)) / 2, np.ptp(v, axis=0)
    order = np.argsort(extent, kind="stable")
    out = {}
    for axis in order.tolist():
        along = next(a for a in order[::-1].tolist() if a != axis)
        out[f"middle, square to {_AXES[axis]}"] = Plane.from_normal(
            middle, np.eye(3)[axis], np.eye(3)[along]
        )
    return out | {f"of {s.name}": s.plane for s in sensors}


def moved(plane: Plane, by: float) -> Plane:
    """Along its normal, mm."""
    return replace(plane, origin=plane.origin + by * plane.normal)
