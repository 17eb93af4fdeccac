"""Plan the ends of channels: chamfered mouths, and pockets for the joint of cord and wire."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...core.arrays import Float, format_point
from ...core.curve import Plane, arc_lengths
from ...core.mesh import Surface
from ..bodies.connector_bay import is_in_bay
from ..kernels.cutting_tools import Frustum, Tool, cylinder
from ..kernels.surface_queries import signed_distance_of
from .wire_channels import NO_BEND_SPACE, Hollow, Lead, LeadStart, WireRouter, Wires

#: Largest angle between the pocket's axis and the path within it.
MAX_POCKET_ANGLE_RAD = np.radians(25)
#: Depth of pockets for the bend of a wire, in that at a level skin: the skin may lean.
DEPTH_FACTORS = (1.0, 1.3, 1.7)
#: Largest slope at which a channel enters: depth gained per length of channel.
MAX_INLET_SLOPE = 0.6


@dataclass(frozen=True)
class Pockets:
    """Pockets for a crimp ferrule or solder joint at each end of a cord.

    Attributes:
        diameter: Diameter, mm.
        length: Length, mm.
        wires: The wires, or None if they come out of the cords' mouths.
        kept: Places that pockets and wires avoid.
    """

    diameter: float
    length: float
    wires: Wires | None = None
    kept: tuple[Hollow, ...] = ()


@dataclass(frozen=True)
class End:
    """One end of a cord.

    Attributes:
        mouth: Mouth (3,) on the skin, mm.
        out: Unit direction (3,) out of the body.
        pocket: Length of the pocket from the mouth, mm; 0 if there is none.
        reason: Why there is no pocket.
        lead: The wire's lead, or None if the wire comes out of the mouth.
        in_bay: Whether the mouth is in the bay.
        unled: Why the wire does not go where it should.
    """

    mouth: Float
    out: Float
    pocket: float
    reason: str
    lead: Lead | None = None
    in_bay: bool = False
    unled: str = ""

    @property
    def wire(self) -> str:
        """Where the wire leaves the body: in the `bay`, by a `bend` next to the mouth, at the
        `mouth`, or `outside` if the joint itself is outside.
        """
        if not self.pocket and not self.in_bay:
            return "outside"
        if self.in_bay or (self.lead and self.lead.to_bay):
            return "bay"
        return "bend" if self.lead else "mouth"

    def hollows(self, pockets: Pockets | None) -> list[Hollow]:
        """Return the hollows next to the channel: points (n, 3) along each, and its radius, mm."""
        out = []
        if pockets and self.pocket:
            along = np.linspace(0, self.pocket, int(self.pocket / 0.25) + 2)
            out.append((self.mouth - along[:, None] * self.out, pockets.diameter / 2))
        if pockets and pockets.wires and self.lead:
            out.append((self.lead.whole, pockets.wires.diameter / 2))
        return out


def plan_ends(
    planes: Sequence[Plane],
    paths: Sequence[Float],
    channel: float,
    wall: float,
    body: Surface,
    pockets: Pockets | None,
) -> list[tuple[End, End]]:
    """Plan both ends of every cord, with their pockets and leads.

    Args:
        planes: Planes of the cords.
        paths: Center lines (q, 3) from mouth to mouth in steps of at most 0.25 mm.
        channel: Diameter of the channels, mm.
        wall: Least wall between hollows, mm.
        body: Surface of the body.
        pockets: Pockets at the ends, or None.
    """
    lines = [line for path in paths for line in (path, path[::-1])]
    outs = [(x[0] - x[1]) / np.linalg.norm(x[0] - x[1]) for x in lines]
    ends = [End(x[0], out, 0.0, "") for x, out in zip(lines, outs, strict=True)]
    if pockets is not None:
        _EndPlanner(planes, lines, ends, channel, wall, body, pockets).plan()
    return list(zip(ends[::2], ends[1::2], strict=True))


class _EndPlanner:
    """Plan pockets and leads one by one; the ends 2 k and 2 k + 1 belong to cord k."""

    def __init__(
        self,
        planes: Sequence[Plane],
        lines: Sequence[Float],
        ends: list[End],
        channel: float,
        wall: float,
        body: Surface,
        pockets: Pockets,
    ) -> None:
        self._planes, self._channel, self._wall, self._body = planes, channel, wall, body
        self._lines, self._ends, self._pockets = lines, ends, pockets

    def plan(self) -> None:
        """Replace the ends by those with pockets and leads."""
        for k in range(len(self._ends)):
            self._plan_pocket(k)
        if self._pockets.wires:
            self._plan_leads(self._pockets.wires)

    def _plan_pocket(self, k: int) -> None:
        """Give an end its pocket if there is room next to those that others may have."""
        others: list[Hollow] = list(self._pockets.kept)
        for j, line in enumerate(self._lines):
            if j // 2 != k // 2:
                count = int(self._pockets.length / np.linalg.norm(line[1] - line[0])) + 4
                others += [(line, self._channel / 2), (line[:count], self._pockets.diameter / 2)]
        others += self._ends[k ^ 1].hollows(self._pockets)
        reason = self._pocket_problem(k, self._pockets.length, others)
        pocket = 0.0 if reason else self._pockets.length
        self._ends[k] = replace(self._ends[k], pocket=pocket, reason=reason)

    def _plan_leads(self, wires: Wires) -> None:
        """Give the wires their leads: first those to the bay, the nearest first, then those that
        come out next to their mouths. A pocket with a lead is as deep as its bend needs.
        """
        router = WireRouter(self._body, wires, self._wall)
        order = list(range(len(self._ends)))
        if wires.bay is not None:
            bay = wires.bay
            order.sort(key=lambda k: float(np.linalg.norm(self._ends[k].mouth - bay.origin)))
            for k in order:
                if is_in_bay(self._ends[k].mouth[None], bay, -0.1)[0]:
                    self._ends[k] = replace(self._ends[k], in_bay=True)
                elif self._ends[k].pocket:
                    self._plan_lead(k, wires, partial(self._to_bay, router, k))
        if wires.relief:
            for k in order:
                end = self._ends[k]
                if end.pocket and not end.lead and not end.in_bay:
                    self._plan_lead(k, wires, partial(self._to_skin, router, k))

    def _to_bay(self, router: WireRouter, k: int, start: LeadStart) -> Lead | str:
        obstacles = self._obstacles(k, start)
        return router.to_bay(self._planes[k // 2], start, self._cord_hollows(k // 2), obstacles)

    def _to_skin(self, router: WireRouter, k: int, start: LeadStart) -> Lead | str:
        return router.to_skin(self._planes[k // 2], start, self._obstacles(k, start))

    def _obstacles(self, k: int, start: LeadStart) -> list[Hollow]:
        """Return the hollows that a lead from `start` keeps away from."""
        depth = start.ferrule + self._pockets.length
        twin = self._ends[k ^ 1]
        own = own_hollows(self._lines[k], twin, depth, self._channel, self._pockets)
        return [*own, *self._pockets.kept, *self._other_hollows(k)]

    def _plan_lead(self, k: int, wires: Wires, find: Callable[[LeadStart], Lead | str]) -> None:
        """Give an end the lead that `find` returns for the shallowest pocket that allows one."""
        end, pockets, reason = self._ends[k], self._pockets, ""
        flare = pockets.diameter / 2 + 2 * chamfer_width(self._wall)
        for factor in DEPTH_FACTORS:
            room = factor * wires.room(self._wall)
            twin = self._ends[k ^ 1].hollows(pockets)
            obstacles = [*twin, *pockets.kept, *self._other_hollows(k)]
            problem = self._pocket_problem(k, pockets.length + room, obstacles)
            if problem:
                reason = reason or f"for its bend the pocket must be deeper, but {problem}"
                break
            result = find(LeadStart(end.mouth, end.out, pockets.diameter / 2, flare, room))
            if isinstance(result, Lead):
                self._ends[k] = replace(end, pocket=pockets.length + room, lead=result)
                return
            reason = result
            if reason != NO_BEND_SPACE:
                break
        if not end.unled:
            self._ends[k] = replace(end, unled=reason)

    def _other_hollows(self, k: int) -> list[Hollow]:
        """Return the hollows of the other cords."""
        count = len(self._ends) // 2
        return [h for j in range(count) if j != k // 2 for h in self._cord_hollows(j)]

    def _cord_hollows(self, cord: int) -> list[Hollow]:
        hollows = [(self._lines[2 * cord], self._channel / 2)]
        for end in self._ends[2 * cord : 2 * cord + 2]:
            hollows += end.hollows(self._pockets)
        return hollows

    def _pocket_problem(self, k: int, length: float, others: Sequence[Hollow]) -> str:
        """Return why a pocket `length` mm deep is impossible, or nothing."""
        line, end = self._lines[k], self._ends[k]
        step = float(np.linalg.norm(line[1] - line[0]))
        count = int(length / step) + 1
        twin = int(max(self._ends[k ^ 1].pocket, length) / step) + 1
        if count + twin > 0.6 * len(line):
            return f"the channel is too short for two pockets of {length:.3g} mm"
        inner = line[count - 1] - line[count + 3]
        if end.out @ inner < np.cos(MAX_POCKET_ANGLE_RAD) * np.linalg.norm(inner):
            return f"the cord bends within {length:.3g} mm of its end"
        axis = line[0] - np.linspace(0, length, count)[:, None] * end.out
        radius = self._pockets.diameter / 2
        depth = signed_distance_of(self._body).unsigned(axis)
        needed = np.minimum(radius + self._wall, MAX_INLET_SLOPE * np.linspace(0, length, count))
        if (depth < needed).any():
            at = axis[int((depth - needed).argmin())]
            return f"there is too little wall near {format_point(at)}"
        for points, hollow in others:
            gap = np.linalg.norm(axis[:, None] - points[None], axis=2).min()
            if gap < radius + hollow + self._wall:
                return "another cord or its wire is too near"
        return ""


def own_hollows(
    line: Float, twin: End, depth: float, channel: float, pockets: Pockets | None
) -> list[Hollow]:
    """Return the hollows of an end's own cord in addition to its pocket.

    Args:
        line: Center line (p, 3) of the channel from this end on, mm.
        twin: The other end.
        depth: Depth of the pocket, mm.
        channel: Diameter of the channel, mm.
        pockets: Pockets at the ends, or None.
    """
    return [(line[arc_lengths(line) > depth], channel / 2), *twin.hollows(pockets)]


def make_end_tools(end: End, channel: float, wall: float, pockets: Pockets | None) -> list[Tool]:
    """Return the tools that shape a channel's end, without the channel of diameter `channel` mm."""
    diameter = pockets.diameter if pockets and end.pocket else channel
    c = chamfer_width(wall)
    tools: list[Tool] = [
        Frustum(
            end.mouth - c * end.out, end.mouth + c * end.out, (diameter / 2, diameter / 2 + 2 * c)
        )
    ]
    if pockets and end.pocket:
        tools.append(cylinder(end.mouth - end.pocket * end.out, end.mouth + end.out, diameter))
        # A cone at the bottom guides the cord into its channel.
        inner = end.mouth - end.pocket * end.out
        step = (diameter - channel) / 2
        tools.append(Frustum(inner - step * end.out, inner, (channel / 2, diameter / 2)))
    if pockets and pockets.wires and end.lead and not end.lead.to_bay:
        at, r = end.lead.exit, pockets.wires.diameter / 2
        tools.append(Frustum(at - c * end.lead.out, at + c * end.lead.out, (r, r + 2 * c)))
    if pockets and pockets.wires and end.lead and end.lead.drop is not None:
        at, drop = end.lead.exit, end.lead.drop
        tools.append(cylinder(at, at + drop, pockets.wires.diameter))
    return tools


def chamfer_width(wall: float) -> float:
    """Return the width of a mouth's chamfer, mm: two mouths a wall apart keep a third of it."""
    return wall / 3
