"""Walls around the sockets of pins."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ....core.arrays import Float, xyz
from ....core.errors import FabricationError
from ....core.mesh import Surface
from ...kernels.cutting_tools import frame
from ...kernels.signed_distance import distances_of
from ..alignment_pins import Pin, gap, rings
from ..check import Check
from ..records import Made, Rules

#: Walls around sockets may be thinner than asked by this: facets and samples, mm.
TOLERANCE = 0.06


def sockets(made: Made, body: Surface, rules: Rules) -> list[Check]:
    """Walls from sockets to grooves and to the skin, sampled on the sockets' surface.
    Raises FabricationError for one that is too thin."""
    if not made.pins:
        return []
    distances = distances_of(body)
    skin, groove = np.inf, np.inf
    where = ["", "", ""]
    hollows = [
        (c.name, cKDTree(points), radius)
        for c in made.channels
        for points, radius in c.hollows(rules.channel, rules.pockets)
    ]
    apart = np.inf
    for k, pin in enumerate(made.pins):
        hull = shell(pin)
        between = float(gap(hull, made.pins[:k]).min())
        if between < apart:
            apart, where[2] = between, xyz(pin.center)
        depth = distances.unsigned(hull)
        if depth.min() < skin:
            skin, where[0] = float(depth.min()), xyz(pin.center)
        for name, line, radius in hollows:
            wall = float(line.query(hull)[0].min()) - radius
            if wall < groove:
                groove, where[1] = wall, f"{xyz(pin.center)}, cord {name}"
    least = rules.inner_wall
    used = least - TOLERANCE
    out = [
        Check("wall from socket to skin", skin, used, "mm", where[0], at_least=True),
        Check("wall from socket to groove", groove, used, "mm", where[1], at_least=True),
    ]
    if np.isfinite(apart):
        out.append(Check("wall from socket to socket", apart, used, "mm", where[2], at_least=True))
    for check in out:
        if not check.holds:
            raise FabricationError(
                f"{check.name}: {check.value:.2f} mm near {check.at}; {least:.2f} mm is needed",
                code="wall-too-thin",
                wall=check.value,
            )
    return out


def shell(pin: Pin) -> Float:
    """Points (n, 3) on both sockets of a pin."""
    heights = np.linspace(-pin.depth, pin.depth, 2 * int(np.ceil(pin.depth / 0.5)) + 1)
    last = len(heights) - 1
    local = [rings(pin.socket / 2, h, bottom=k in (0, last)) for k, h in enumerate(heights)]
    return np.asarray(pin.center + np.concatenate(local) @ frame(pin.axis).T)
