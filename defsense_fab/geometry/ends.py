"""The ends of channels: chamfered mouths, and pockets for the joint of cord and wire."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import igl
import numpy as np

from ..core.arrays import Float, place
from ..core.curve import Plane
from ..core.mesh import Surface
from .bay import inside
from .leads import Hollow, Lead, Pit, Router, Wires
from .tools import Frustum, Tool, cylinder

#: The pocket's axis and the path within it differ by no more than this, rad.
_STRAIGHT = np.radians(25)
#: A channel may enter at up to this slope: depth gained per length of channel.
INLET_SLOPE = 0.6


@dataclass(frozen=True)
class Pockets:
    """Room for a crimp ferrule or solder joint at each end of a cord: mm; and for their `wires`,
    or None where these come out of the cords' mouths."""

    diameter: float
    length: float
    wires: Wires | None = None

    def depth(self, wall: float) -> float:
        """From the skin to the bottom of a pocket whose wire turns aside, mm."""
        return self.length + (self.wires.room(wall) if self.wires else 0.0)


@dataclass(frozen=True)
class End:
    """One end of a cord: its `mouth` (3,) mm on the skin, the unit direction `out` (3,), the
    pocket's length from the mouth (0: none) and why there is none; its wire's `lead`, or None where
    it comes out of the mouth (which may lie in the bay), and why it does not go where it should."""

    mouth: Float
    out: Float
    pocket: float
    reason: str
    lead: Lead | None = None
    in_bay: bool = False
    unled: str = ""

    @property
    def wire(self) -> str:
        """Where its wire leaves the body: in the `bay`, by a `bend` beside the `mouth`, or there;
        `outside` where the joint itself is."""
        if not self.pocket:
            return "outside"
        if self.in_bay or (self.lead and self.lead.to_bay):
            return "bay"
        return "bend" if self.lead else "mouth"


def ends_of(
    planes: Sequence[Plane],
    paths: Sequence[Float],
    channel: float,
    wall: float,
    body: Surface,
    pockets: Pockets | None,
) -> list[tuple[End, End]]:
    """Both ends of every channel of diameter `channel` mm; `paths` are the channels' centre lines
    from mouth to mouth, each (q, 3) mm in steps of at most 0.25 mm, in their `planes`."""
    tree = igl.AABB()
    tree.init(body.vertices, body.faces)
    deep = pockets.depth(wall) if pockets else 0.0
    ends = []
    for k, own in enumerate(paths):
        others = [p for j, p in enumerate(paths) if j != k]
        for line in (own, own[::-1]):
            outward = line[0] - line[1]
            outward /= np.linalg.norm(outward)
            pocket, reason = 0.0, ""
            if pockets is not None:
                for length in dict.fromkeys((deep, pockets.length)):
                    reason = _refusal(
                        line, outward, others, channel, wall, body, tree, pockets, length, deep
                    )
                    if not reason:
                        pocket = length
                        break
            ends.append(End(line[0], outward, pocket, reason))
    if pockets and pockets.wires:
        ends = _led(ends, planes, paths, channel, wall, body, pockets, pockets.wires)
    return list(zip(ends[::2], ends[1::2], strict=True))


def _led(
    ends: list[End],
    planes: Sequence[Plane],
    paths: Sequence[Float],
    channel: float,
    wall: float,
    body: Surface,
    pockets: Pockets,
    wires: Wires,
) -> list[End]:
    """The ends with their wires' leads: first those to the bay, the nearest first, then those that
    come out beside their mouths. Without a lead a pocket is no deeper than its ferrule."""
    router = Router(body, wires, wall)
    deep, out = pockets.depth(wall), list(ends)

    def hollows(owner: int) -> list[Hollow]:
        found = [(paths[owner], channel / 2)]
        for end in (out[2 * owner], out[2 * owner + 1]):
            if end.pocket:
                along = np.linspace(0, end.pocket, int(end.pocket / 0.25) + 2)
                found.append((end.mouth - along[:, None] * end.out, pockets.diameter / 2))
            if end.lead:
                found.append((end.lead.whole, wires.diameter / 2))
        return found

    def pit(end: End) -> Pit:
        flare = pockets.diameter / 2 + 2 * chamfer(wall)
        return Pit(end.mouth, end.out, pockets.diameter / 2, flare, wires.room(wall))

    waiting = [k for k, end in enumerate(ends) if end.pocket == deep]
    for k, end in enumerate(ends):
        if 0 < end.pocket < deep:
            out[k] = replace(end, unled=f"there is no room for a pocket of {deep:.1f} mm")
    if wires.bay is not None:
        bay = wires.bay
        waiting.sort(key=lambda k: float(np.linalg.norm(ends[k].mouth - bay.origin)))
    for to_bay in (True, False):
        for k in list(waiting):
            owner = k // 2
            others = [h for j in range(len(paths)) if j != owner for h in hollows(j)]
            lead: Lead | str | None = None
            if to_bay and wires.bay is not None:
                if inside(ends[k].mouth[None], wires.bay, -0.1)[0]:
                    out[k] = replace(out[k], pocket=pockets.length, in_bay=True)
                    waiting.remove(k)
                    continue
                lead = router.to_bay(planes[owner], pit(ends[k]), hollows(owner), others)
            elif not to_bay and wires.relief:
                twin = out[k ^ 1].lead
                own = [(twin.whole, wires.diameter / 2)] if twin else []
                lead = router.to_skin(planes[owner], pit(ends[k]), [*own, *others])
            if isinstance(lead, str):
                out[k] = replace(out[k], unled=lead)
            elif lead is not None:
                out[k] = replace(out[k], lead=lead)
                waiting.remove(k)
    for k in waiting:
        why = out[k].unled or ("there is no room for a bend beside it" if wires.relief else "")
        out[k] = replace(out[k], pocket=pockets.length, unled=why)
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
    if pockets and pockets.wires and end.lead and not end.lead.to_bay:
        at, r = end.lead.exit, pockets.wires.diameter / 2
        tools.append(Frustum(at - c * end.lead.out, at + c * end.lead.out, (r, r + 2 * c)))
    if pockets and pockets.wires and end.lead and end.lead.drop is not None:
        at, drop = end.lead.exit, end.lead.drop
        tools.append(cylinder(at, at + drop, pockets.wires.diameter))
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
    length: float,
    longest: float,
) -> str:
    """Why a pocket `length` mm deep cannot be where others' reach the `longest`, or nothing."""
    step = float(np.linalg.norm(line[1] - line[0]))
    count, most = int(length / step) + 1, int(longest / step) + 1
    if 2 * count > 0.6 * len(line):
        return f"the channel is too short for two pockets of {length:g} mm"
    inner = line[count - 1] - line[count + 3]
    if out @ inner < np.cos(_STRAIGHT) * np.linalg.norm(inner):
        return f"the cord bends within {length:g} mm of its end"
    axis = line[0] - np.linspace(0, length, count)[:, None] * out
    radius = pockets.diameter / 2
    depth = np.sqrt(tree.squared_distance(body.vertices, body.faces, axis)[0])
    needed = np.minimum(radius + wall, INLET_SLOPE * np.linspace(0, length, count))
    if (depth < needed).any():
        at = axis[int((depth - needed).argmin())]
        return f"too little wall near {place(at)}"
    for other in others:
        gap = np.linalg.norm(axis[:, None] - other[None], axis=2).min(axis=0)
        steps = np.arange(len(other))
        pocketed = np.minimum(steps, steps[::-1]) <= most + 2  # it may have pockets of its own
        if (gap < radius + np.where(pocketed, radius, channel / 2) + wall).any():
            return "another cord lies too near"
    return ""
