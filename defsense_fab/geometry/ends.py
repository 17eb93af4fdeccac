"""The ends of channels: chamfered mouths, and pockets for the joint of cord and wire."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import igl
import numpy as np

from ..core.arrays import Float, place
from ..core.mesh import Surface
from .tools import Frustum, Tool, cylinder

#: The pocket's axis and the path within it differ by no more than this, rad.
_STRAIGHT = np.radians(25)
#: A channel may enter at up to this slope: depth gained per length of channel.
INLET_SLOPE = 0.6


@dataclass(frozen=True)
class End:
    """One end of a cord: its `mouth` (3,) mm on the skin, the unit direction `out` (3,), the
    pocket's length from the mouth (0: none) and why there is none."""

    mouth: Float
    out: Float
    pocket: float
    reason: str


@dataclass(frozen=True)
class Pockets:
    """Room for a crimp ferrule or solder joint at each end of a cord: mm."""

    diameter: float
    length: float


def ends_of(
    paths: Sequence[Float],
    channel: float,
    wall: float,
    body: Surface,
    pockets: Pockets | None,
) -> list[tuple[End, End]]:
    """Both ends of every channel of diameter `channel` mm; `paths` are the channels' centre lines
    from mouth to mouth, each (q, 3) mm in steps of at most 0.25 mm."""
    tree = igl.AABB()
    tree.init(body.vertices, body.faces)
    out = []
    for k, own in enumerate(paths):
        others = [p for j, p in enumerate(paths) if j != k]
        pair = []
        for line in (own, own[::-1]):
            outward = line[0] - line[1]
            outward /= np.linalg.norm(outward)
            pocket, reason = 0.0, ""
            if pockets is not None:
                reason = _refusal(line, outward, others, channel, wall, body, tree, pockets)
                pocket = 0.0 if reason else pockets.length
            pair.append(End(line[0], outward, pocket, reason))
        out.append((pair[0], pair[1]))
    return out


def end_tools(end: End, channel: float, wall: float, pockets: Pockets | None) -> list[Tool]:
    """What is cut out at a channel's end, besides the channel of diameter `channel` mm."""
    wide = pockets.diameter if pockets and end.pocket else channel
    c = chamfer(wall)
    tools: list[Tool] = [
        Frustum(end.mouth - c * end.out, end.mouth + c * end.out, (wide / 2, wide / 2 + 2 * c))
    ]
    if pockets and end.pocket:
        tools.append(cylinder(end.mouth - end.pocket * end.out, end.mouth + end.out, wide))
        # A cone at the bottom: the cord runs into its channel, not against an edge.
        inner = end.mouth - end.pocket * end.out
        step = (wide - channel) / 2
        tools.append(Frustum(inner - step * end.out, inner, (channel / 2, wide / 2)))
    return tools


def chamfer(wall: float) -> float:
    """Width of a mouth's chamfer, mm: two mouths a wall apart keep a third of it."""
    return wall / 3


def _refusal(
    line: Float,
    out: Float,
    others: Sequence[Float],
    channel: float,
    wall: float,
    body: Surface,
    tree: Any,
    pockets: Pockets,
) -> str:
    """Why the pocket cannot be, or nothing."""
    step = float(np.linalg.norm(line[1] - line[0]))
    count = int(pockets.length / step) + 1
    if 2 * count > 0.6 * len(line):
        return f"the channel is too short for two pockets of {pockets.length:g} mm"
    inner = line[count - 1] - line[count + 3]
    if out @ inner < np.cos(_STRAIGHT) * np.linalg.norm(inner):
        return f"the cord bends within {pockets.length:g} mm of its end"
    axis = line[0] - np.linspace(0, pockets.length, count)[:, None] * out
    radius = pockets.diameter / 2
    depth = np.sqrt(tree.squared_distance(body.vertices, body.faces, axis)[0])
    needed = np.minimum(radius + wall, INLET_SLOPE * np.linspace(0, pockets.length, count))
    if (depth < needed).any():
        at = axis[int((depth - needed).argmin())]
        return f"too little wall near {place(at)}"
    for other in others:
        gap = np.linalg.norm(axis[:, None] - other[None], axis=2).min(axis=0)
        steps = np.arange(len(other))
        pocketed = np.minimum(steps, steps[::-1]) <= count + 2  # it may have pockets of its own
        if (gap < radius + np.where(pocketed, radius, channel / 2) + wall).any():
            return "another cord lies too near"
    return ""
