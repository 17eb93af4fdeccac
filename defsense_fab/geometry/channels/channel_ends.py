"""The ends of channels: chamfered mouths, and pockets for the joint of cord and wire."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane, arc_lengths
from ...core.mesh import Surface
from ..bodies.connector_bay import inside
from ..kernels.cutting_tools import Frustum, Tool, cylinder
from ..kernels.surface_queries import signed_distance_of
from .wire_channels import NO_TURN, Hollow, Lead, Pit, Router, Wires

#: The pocket's axis and the path within it differ by no more than this, rad.
_STRAIGHT = np.radians(25)
#: How much deeper than at a level skin pockets may be for the bend of a wire: the skin leans.
_DEEPER = (1.0, 1.3, 1.7)
#: A channel may enter at up to this slope: depth gained per length of channel.
MAX_INLET_SLOPE = 0.6


@dataclass(frozen=True)
class Pockets:
    """Room for a crimp ferrule or solder joint at each end of a cord: mm; and for their `wires`,
    or None where these come out of the cords' mouths."""

    diameter: float
    length: float
    wires: Wires | None = None


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
        if not self.pocket and not self.in_bay:
            return "outside"
        if self.in_bay or (self.lead and self.lead.to_bay):
            return "bay"
        return "bend" if self.lead else "mouth"

    def hollows(self, pockets: Pockets | None) -> list[Hollow]:
        """Points (n, 3) mm along what is hollow besides the channel, and its radius there, mm."""
        out = []
        if pockets and self.pocket:
            along = np.linspace(0, self.pocket, int(self.pocket / 0.25) + 2)
            out.append((self.mouth - along[:, None] * self.out, pockets.diameter / 2))
        if pockets and pockets.wires and self.lead:
            out.append((self.lead.whole, pockets.wires.diameter / 2))
        return out


class Ends:
    """The `ends` of all cords as they are made one by one: 2 k and 2 k + 1 are cord k's.

    The channels have the diameter `channel` mm; `paths` are their centre lines from mouth to mouth,
    each (q, 3) mm in steps of at most 0.25 mm, in their `planes`.
    """

    def __init__(
        self,
        planes: Sequence[Plane],
        paths: Sequence[Float],
        channel: float,
        wall: float,
        body: Surface,
        pockets: Pockets | None,
    ) -> None:
        self._planes, self._channel, self._wall, self._body = planes, channel, wall, body
        self._pockets = pockets
        self._lines = [line for path in paths for line in (path, path[::-1])]
        outs = [(x[0] - x[1]) / np.linalg.norm(x[0] - x[1]) for x in self._lines]
        self.ends = [End(x[0], out, 0.0, "") for x, out in zip(self._lines, outs, strict=True)]

    def made(self) -> list[tuple[End, End]]:
        """Both ends of every cord, with their pockets and leads."""
        for k in range(len(self.ends)):
            self._pocket(k)
        if self._pockets and self._pockets.wires:
            self._lead_all(self._pockets, self._pockets.wires)
        return list(zip(self.ends[::2], self.ends[1::2], strict=True))

    def _pocket(self, k: int) -> None:
        """Give an end its pocket, where there is room beside those that others may have."""
        if self._pockets is None:
            return
        others: list[Hollow] = []
        for j, line in enumerate(self._lines):
            if j // 2 != k // 2:
                count = int(self._pockets.length / np.linalg.norm(line[1] - line[0])) + 4
                others += [(line, self._channel / 2), (line[:count], self._pockets.diameter / 2)]
        others += self.ends[k ^ 1].hollows(self._pockets)
        reason = self._refusal(k, self._pockets, self._pockets.length, others)
        pocket = 0.0 if reason else self._pockets.length
        self.ends[k] = replace(self.ends[k], pocket=pocket, reason=reason)

    def _lead_all(self, pockets: Pockets, wires: Wires) -> None:
        """Give the wires their leads: first those to the bay, the nearest first, then those that
        come out beside their mouths. A pocket with a lead is as deep as its bend needs."""
        router = Router(self._body, wires, self._wall)
        order = list(range(len(self.ends)))
        if wires.bay is not None:
            bay = wires.bay
            order.sort(key=lambda k: float(np.linalg.norm(self.ends[k].mouth - bay.origin)))
            for k in order:
                if inside(self.ends[k].mouth[None], bay, -0.1)[0]:
                    self.ends[k] = replace(self.ends[k], in_bay=True)
                elif self.ends[k].pocket:
                    self._lead(k, pockets, wires, partial(self._to_bay, router, k))
        if wires.relief:
            for k in order:
                end = self.ends[k]
                if end.pocket and not end.lead and not end.in_bay:
                    self._lead(k, pockets, wires, partial(self._to_skin, router, k))

    def _to_bay(self, router: Router, k: int, pit: Pit) -> Lead | str:
        apart = self._apart(k, pit)
        return router.to_bay(self._planes[k // 2], pit, self._hollows(k // 2), apart)

    def _to_skin(self, router: Router, k: int, pit: Pit) -> Lead | str:
        return router.to_skin(self._planes[k // 2], pit, self._apart(k, pit))

    def _apart(self, k: int, pit: Pit) -> list[Hollow]:
        """What a lead that begins in the pit keeps away from."""
        if self._pockets is None:
            return self._others(k)
        depth = pit.ferrule + self._pockets.length
        twin = self.ends[k ^ 1]
        own = beside(self._lines[k], twin, depth, self._channel, self._pockets)
        return [*own, *self._others(k)]

    def _lead(
        self, k: int, pockets: Pockets, wires: Wires, find: Callable[[Pit], Lead | str]
    ) -> None:
        """The lead that `find` finds from the shallowest pocket that allows one."""
        end, reason = self.ends[k], ""
        flare = pockets.diameter / 2 + 2 * chamfer(self._wall)
        for deeper in _DEEPER:
            room = deeper * wires.room(self._wall)
            around = [*self.ends[k ^ 1].hollows(pockets), *self._others(k)]
            refused = self._refusal(k, pockets, pockets.length + room, around)
            if refused:
                reason = reason or f"for its bend the pocket must be deeper, but {refused}"
                break
            found = find(Pit(end.mouth, end.out, pockets.diameter / 2, flare, room))
            if isinstance(found, Lead):
                self.ends[k] = replace(end, pocket=pockets.length + room, lead=found)
                return
            reason = found
            if reason != NO_TURN:
                break
        if not end.unled:
            self.ends[k] = replace(end, unled=reason)

    def _others(self, k: int) -> list[Hollow]:
        """What is hollow of the other cords."""
        count = len(self.ends) // 2
        return [h for j in range(count) if j != k // 2 for h in self._hollows(j)]

    def _hollows(self, cord: int) -> list[Hollow]:
        found = [(self._lines[2 * cord], self._channel / 2)]
        for end in self.ends[2 * cord : 2 * cord + 2]:
            found += end.hollows(self._pockets)
        return found

    def _refusal(self, k: int, pockets: Pockets, length: float, others: Sequence[Hollow]) -> str:
        """Why a pocket `length` mm deep cannot be, or nothing."""
        line, end = self._lines[k], self.ends[k]
        step = float(np.linalg.norm(line[1] - line[0]))
        count = int(length / step) + 1
        twin = int(max(self.ends[k ^ 1].pocket, length) / step) + 1
        if count + twin > 0.6 * len(line):
            return f"the channel is too short for two pockets of {length:.3g} mm"
        inner = line[count - 1] - line[count + 3]
        if end.out @ inner < np.cos(_STRAIGHT) * np.linalg.norm(inner):
            return f"the cord bends within {length:.3g} mm of its end"
        axis = line[0] - np.linspace(0, length, count)[:, None] * end.out
        radius = pockets.diameter / 2
        depth = signed_distance_of(self._body).unsigned(axis)
        needed = np.minimum(radius + self._wall, MAX_INLET_SLOPE * np.linspace(0, length, count))
        if (depth < needed).any():
            at = axis[int((depth - needed).argmin())]
            return f"there is too little wall near {format_point(at)}"
        for points, hollow in others:
            gap = np.linalg.norm(axis[:, None] - points[None], axis=2).min()
            if gap < radius + hollow + self._wall:
                return "another cord or its wire lies too near"
        return ""


def beside(
    line: Float, twin: End, depth: float, channel: float, pockets: Pockets | None
) -> list[Hollow]:
    """What is hollow of an end's own cord besides its pocket, `depth` mm deep: the channel (of a
    diameter, mm) along `line` from there on, and the other end."""
    return [(line[arc_lengths(line) > depth], channel / 2), *twin.hollows(pockets)]


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
