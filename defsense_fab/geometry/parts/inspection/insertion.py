"""Whether cords and wires lie in their grooves, and can be laid in."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from ....core.arrays import xyz
from ....core.errors import FabricationError
from ...kernels import triangle_kernel
from ..check import Check
from ..records import Made, Rules

#: mm^3 of solid that a cord may touch: rounding of facets.
TOUCH = 0.02
_OPENED = (0.3, 2.0, 10.0)  # mm between two halves


def insertion(made: Made, pieces: Sequence[Any], rules: Rules) -> Check:
    """Whether every cord with its wires lies in its groove and can be laid in: closed it touches no
    part; with the two sides of a cut apart, those of the cut touch neither.
    Raises FabricationError where one does."""
    worst = 0.0
    wire = rules.pockets.wires.wire if rules.pockets and rules.pockets.wires else 0.0
    cords = [triangle_kernel.union([c.cord(rules.cord), *c.wires(wire)]) for c in made.channels]
    for channel, cord in zip(made.channels, cords, strict=True):
        for piece in pieces:
            worst = max(worst, touch(cord, piece, f"cord {channel.name!r} in its closed groove"))
    for cut in made.cuts:
        for c in cut.cords:
            what = f"cord {made.channels[c].name!r} as its groove is closed"
            for side, way in zip(cut.sides, (-cut.plane.normal, cut.plane.normal), strict=True):
                for i, lift in itertools.product(side, _OPENED):
                    worst = max(worst, touch(cords[c], pieces[i].translate(lift * way), what))
    return Check("cord in solid, closed and opened", worst, TOUCH, "mm3", "")


def touch(rod: Any, piece: Any, what: str, remedy: str = "move the cord or its plane") -> float:
    """How much of a piece two solids (manifold3d) share, mm^3; `what` the first is. Raises
    FabricationError, with the `remedy`, where it is more than facets are rounded by."""
    common = rod ^ piece
    volume = float(common.volume())
    if volume > TOUCH:
        at = triangle_kernel.centroid(triangle_kernel.to_surface(common))
        raise FabricationError(
            f"{what} meets {volume:.2f} mm^3 of solid near {xyz(at)}; {remedy}",
            code="overlaps-solid",
            volume=volume,
        )
    return volume
