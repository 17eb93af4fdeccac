"""Parts and what was removed are the body, and no two parts are in one place."""

from __future__ import annotations

from typing import Any

import igl
import numpy as np

from ....core.arrays import xyz
from ....core.errors import FabricationError
from ...kernels import triangle_kernel
from ..check import Check
from ..records import Made, Part

#: Largest relative difference between the body and its parts plus what was removed.
CONSERVATION = 1e-3
#: Of the body's volume, that two parts may overlap: rounding to single precision.
_OVERLAP = 1e-5
_POINTS = 100_000


def volumes(made: Made) -> Check:
    """Conservation of volume. Raises FabricationError where it fails."""
    total = sum(p.volume for p in made.parts) + made.cut_out
    error = abs(total / made.body_volume - 1)
    if not error <= CONSERVATION:
        raise FabricationError(
            f"parts and what was cut out add up to {total:.1f} mm^3 but the body has"
            f" {made.body_volume:.1f}; the cut failed: move a cord plane slightly",
            code="volume-not-conserved",
        )
    return Check("volume lost or gained, of the body", error, CONSERVATION, "", "")


def apart(made: Made) -> Check:
    """No two exported parts overlap. Raises FabricationError where two do."""
    solids = [triangle_kernel.to_manifold(p.surface, p.name) for p in made.parts]
    worst, at = 0.0, ""
    for i, a in enumerate(solids):
        for j in range(i):
            common = a ^ solids[j]
            volume = float(common.volume())
            if volume > _OVERLAP * made.body_volume:
                volume = min(volume, _common(common, made.parts[i], made.parts[j]))
            if volume > worst:
                worst, at = (
                    volume,
                    xyz(triangle_kernel.centroid(triangle_kernel.to_surface(common))),
                )
            if volume > _OVERLAP * made.body_volume:
                raise FabricationError(
                    f"{made.parts[j].name} and {made.parts[i].name} overlap by {volume:.1f} mm^3"
                    f" near {at}; the cut failed: move a cord plane slightly",
                    code="parts-overlap",
                    volume=volume,
                )
    return Check("overlap of two parts", worst, _OVERLAP * made.body_volume, "mm3", at)


def _common(claimed: Any, a: Part, b: Part) -> float:
    """The volume (mm^3) that two parts have in common where they are said to: the share of points
    there that lie in both. Faces of one cut are rounded apart by 1e-5 mm, and now and then a
    boolean operation makes much of that."""
    bounds = triangle_kernel.to_surface(claimed).bounds
    points = np.random.default_rng(0).uniform(bounds[0], bounds[1], (_POINTS, 3))
    both = np.ones(len(points), bool)
    for s in (a.surface, b.surface):
        both &= np.asarray(igl.fast_winding_number(s.vertices, s.faces, points)) > 0.5
    return float(both.mean() * np.prod(np.ptp(bounds, axis=0)))
