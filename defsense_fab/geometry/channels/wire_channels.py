"""Route channels for the wires: from the joint with the cord by a bend to the bay or the skin.

A wire that leaves its pocket by a bend cannot pull its ferrule out: the bend is its strain relief.
The wire lies entirely in the cord's plane, so that it is laid into the same open joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Bool, Float
from ...core.curve import Plane, arc_lengths
from ...core.mesh import Surface
from ..bodies.connector_bay import is_in_bay, outside_bay, without_bay
from ..kernels import surface_queries, triangle_kernel
from ..kernels.cutting_tools import Prism
from ..kernels.surface_queries import signed_distance_of
from .planar_routing import HEADINGS, Grid, PlanarRoute, find_route

SPACING_MM = 0.25  # between points of a lead
CELL_MM, MAX_CELLS_ACROSS = 0.3, 400  # of the grid on which routes are searched
#: Least slope at which a lead may emerge: depth gained per length.
MAX_EXIT_SLOPE = 0.45
BAY_MARGIN_MM = 0.6  # from the bay's walls to the end of a lead
TOLERANCE_MM = 0.02
MAX_SKIN_LEAD_MM = 15.0  # of a straight lead to the skin
MAX_DROP_MM = 25.0  # of a hole from a plane to the bay
FIRST_BEND_MOVES = range(HEADINGS // 8, HEADINGS // 2 + 1)  # 45 to 180 degrees
BEND_DIAMETERS = 2.0  # radius of bends, in diameters of a wire's channel


#: Reason for a wire without lead if it cannot even leave its pocket.
NO_BEND_SPACE = "there is not enough space for the bend of the wire"


@dataclass(frozen=True)
class Wires:
    """The wires of all cords.

    Attributes:
        wire: Diameter of the wire, mm.
        diameter: Diameter of its channel, mm.
        bay: The connector bay, or None.
        relief: Whether wires that do not reach the bay come out of the skin by a bend.
    """

    wire: float
    diameter: float
    bay: Prism | None = None
    relief: bool = True

    @property
    def bend(self) -> float:
        """Radius of a bend, mm."""
        return BEND_DIAMETERS * self.diameter

    def room(self, wall: float) -> float:
        """Return the depth of a ferrule behind whose end the wire turns aside, mm, for a wall in
        mm.
        """
        return self.bend + self.diameter / 2 + wall


@dataclass(frozen=True)
class Lead:
    """A wire's channel in a plane.

    Attributes:
        plane: The plane.
        way: Route in the plane.
        exit: Exit (3,) in the bay or the skin, mm, straight ahead of the route.
        run: How far its tool continues from the route's end, mm.
        to_bay: Whether it leads to the bay.
        drop: Straight hole (3,) along the normal from the route's end into the bay, mm, if the
            plane passes next to the bay.
    """

    plane: Plane
    way: PlanarRoute
    exit: Float
    run: float
    to_bay: bool
    drop: Float | None = None

    @cached_property
    def inside(self) -> Float:
        """Center line (p, 3) in the plane, from the ferrule to its exit, mm."""
        line = self.plane.to_world(self.way.sample(SPACING_MM))
        return line if self.to_bay else np.concatenate([line, self.exit[None]])

    @property
    def length(self) -> float:
        """Length from the ferrule to the exit, mm."""
        down = 0.0 if self.drop is None else float(np.linalg.norm(self.drop))
        return float(np.linalg.norm(np.diff(self.inside, axis=0), axis=1).sum()) + down

    @property
    def whole(self) -> Float:
        """Points (p, 3) along the center line with its drop, mm."""
        return self.inside if self.drop is None else np.concatenate([self.inside, self.hole])

    @property
    def hole(self) -> Float:
        """Points (q, 3) along the drop, mm."""
        assert self.drop is not None
        count = int(np.linalg.norm(self.drop) / SPACING_MM) + 2
        return np.asarray(self.exit + np.linspace(0, 1, count)[:, None] * self.drop)

    @property
    def path(self) -> Float:
        """Corners (p, 3) in the plane, from the ferrule to its exit, mm."""
        line = self.plane.to_world(self.way.polyline)
        return line if self.to_bay else np.concatenate([line, self.exit[None]])

    @property
    def line(self) -> Float:
        """The tool's corners (p, 3): along the route and its run, mm."""
        line = self.plane.to_world(self.way.polyline)
        return np.concatenate([line, line[-1:] + self.run * self.out]) if self.run else line

    @property
    def out(self) -> Float:
        """Direction (3,) at its end."""
        return _direction(self.plane, self.way)


@dataclass(frozen=True)
class LeadStart:
    """The pocket in which a lead starts.

    Attributes:
        mouth: Its mouth (3,), mm.
        out: Unit direction (3,) out of the body.
        radius: Its radius, mm.
        flare: Radius of its mouth's chamfer, mm.
        ferrule: Depth at which the ferrule ends, mm.
    """

    mouth: Float
    out: Float
    radius: float
    flare: float
    ferrule: float


#: Points (n, 3) along a hollow, mm, and the radius around them, mm.
Hollow = tuple[Float, float]


class WireRouter:
    """Find room for leads in one body.

    Args:
        body: Surface of the body with its bay.
        wires: The wires.
        wall: Least wall, mm.
    """

    def __init__(self, body: Surface, wires: Wires, wall: float) -> None:
        self.wires, self._wall, self._body = wires, wall, body
        self._skin = without_bay(body, wires.bay) if wires.bay else body
        self._depth = signed_distance_of(self._skin).unsigned
        self._grids: dict[int, tuple[Float, float, Float, Any]] = {}

    def to_bay(
        self,
        plane: Plane,
        start: LeadStart,
        own_hollows: Sequence[Hollow],
        others: Sequence[Hollow],
    ) -> Lead | str:
        """Route a lead to the bay.

        Args:
            plane: Plane of the cord.
            start: Pocket in which the lead starts.
            own_hollows: All hollows of its cord.
            others: Hollows that it keeps away from all along.

        Returns:
            The lead, or why there is none.
        """
        other_trees = self._trees(others)
        starts = [w for w in self._bends(plane, start) if self._is_clear(plane, w, other_trees)]
        if not starts:
            return NO_BEND_SPACE
        low, cell, skin, bay = self._plane_grid(plane)
        own_trees = self._trees(own_hollows)
        solid = ~bay & (skin > 0)
        cells = plane.to_world(low + cell * np.argwhere(solid))
        room = skin.copy()
        gaps = (
            _gap(cells, [*own_trees, *other_trees], self._min_distance + 2 * cell)
            - self._min_distance
        )
        room[solid] = np.minimum(skin[solid], gaps)
        drops: dict[tuple[int, int], Float] = {}
        goal = bay
        if not bay.any():
            drops = self._find_drops(plane, low, cell, room, [*own_trees, *other_trees])
            goal = np.zeros_like(bay)
            if not drops:
                return "its plane passes too far from the connector bay"
            goal[tuple(np.array(list(drops)).T)] = True
        grid = Grid(low, cell, room, goal)
        way = find_route(starts, grid)
        if way is None:
            return "no route in its plane to the connector bay keeps the walls"
        x, y = way.arcs[-1, 2].tolist()
        drop = drops.get(grid.cell_of(x, y) or (-1, -1))
        # Above a hole the groove continues almost to the hole's far wall: kernels fail on tangents.
        run = 0.0 if drop is None else 0.45 * self.wires.diameter
        lead = Lead(plane, way, plane.to_world(way.arcs[-1, 2]), run, to_bay=True, drop=drop)
        return (
            lead
            if self._is_clear(plane, way, other_trees)
            else "the route to the connector bay does not keep the walls"
        )

    def to_skin(self, plane: Plane, start: LeadStart, others: Sequence[Hollow]) -> Lead | str:
        """Return the shortest lead by a bend to the skin next to the mouth, or why there is
        none.
        """
        other_trees = self._trees(others)
        leads = []
        for way in self._bends(plane, start, straight=False):
            lead = self._extend_to_skin(plane, way, start)
            if lead is not None and self._emerges(lead, other_trees):
                leads.append(lead)
        return min(leads, key=lambda w: w.way.length) if leads else NO_BEND_SPACE

    def _trees(self, hollows: Sequence[Hollow]) -> list[tuple[Any, float]]:
        """Return search trees of the hollows in the solid, with their radii."""
        solid = [(outside_bay(points, self.wires.bay), radius) for points, radius in hollows]
        return [(cKDTree(points), radius) for points, radius in solid if len(points)]

    @property
    def _min_distance(self) -> float:
        return self.wires.diameter / 2 + self._wall

    def _plane_grid(self, plane: Plane) -> tuple[Float, float, Float, Any]:
        """Return the cells of a plane: the lower corner, their size, the room to the skin beyond a
        lead's wall (below zero outside) and whether they are in the bay.
        """
        if id(plane) not in self._grids:
            flat = (self._body.vertices - plane.origin) @ plane.axes[:, :2]
            low, high = flat.min(axis=0), flat.max(axis=0)
            cell = max(CELL_MM, float((high - low).max()) / MAX_CELLS_ACROSS)
            nx, ny = (np.ceil((high - low) / cell).astype(int) + 1).tolist()
            cells = np.indices((nx, ny)).reshape(2, -1).T
            points = np.ascontiguousarray(plane.to_world(low + cell * cells))
            bay = self.wires.bay
            assert bay is not None
            goal, within = is_in_bay(points, bay, BAY_MARGIN_MM), is_in_bay(points, bay)
            room = np.full(len(points), -1.0)
            free = self._section(plane, low, cell, (nx, ny)).ravel() | within
            room[free] = self._depth(points[free]) - self._min_distance
            self._grids[id(plane)] = (low, cell, room.reshape(nx, ny), goal.reshape(nx, ny))
        return self._grids[id(plane)]

    def _section(self, plane: Plane, low: Float, cell: float, shape: tuple[int, int]) -> Bool:
        """Return which cells' centers lie in the body: every crossing of an outline with a row of
        cells flips the rest of the row.
        """
        turned = np.zeros(shape, int)
        body = triangle_kernel.to_manifold(self._body, "the body")
        flat = triangle_kernel.to_plane_frame(body, plane.axes, plane.origin)
        for outline in flat.slice(0.0).to_polygons():
            a = (np.asarray(outline, float) - low) / cell
            for (x0, y0), (x1, y1) in zip(a, np.roll(a, -1, axis=0), strict=True):
                rows = np.arange(np.ceil(min(y0, y1)), np.ceil(max(y0, y1)))
                rows = rows[(rows >= 0) & (rows < shape[1])]
                x = np.ceil(x0 + (rows - y0) / (y1 - y0) * (x1 - x0)) if len(rows) else rows
                np.add.at(turned, (np.clip(x, 0, shape[0] - 1).astype(int), rows.astype(int)), 1)
        return np.asarray(turned.cumsum(axis=0) % 2 == 1)

    def _find_drops(
        self, plane: Plane, low: Float, cell: float, room: Float, trees: Sequence[tuple[Any, float]]
    ) -> dict[tuple[int, int], Float]:
        """Return the cells from which a straight hole along the plane's normal reaches the bay and
        keeps its walls, and the hole (3,), mm.
        """
        bay = self.wires.bay
        assert bay is not None
        cells = np.argwhere(room > cell)
        foot = plane.to_world(low + cell * cells)
        heights = np.arange(0.0, MAX_DROP_MM, SPACING_MM)
        clearance = self._min_distance + cell  # a route ends somewhere in a cell
        out: dict[tuple[int, int], Float] = {}
        for normal in (plane.normal, -plane.normal):
            levels = np.full(len(cells), -1)
            for k in range(len(heights))[::-1]:
                levels[is_in_bay(foot + heights[k] * normal, bay, BAY_MARGIN_MM)] = k
            owners = np.repeat(np.arange(len(cells)), levels + 1)
            height = np.concatenate([heights[: k + 1] for k in levels] or [heights[:0]])
            line = foot[owners] + height[:, None] * normal
            solid = ~is_in_bay(line, bay)
            room_there = np.minimum(self._depth(line[solid]), _gap(line[solid], trees, clearance))
            blocked = owners[solid][room_there < clearance]
            for k in np.setdiff1d(np.flatnonzero(levels >= 0), blocked):
                out[(int(cells[k, 0]), int(cells[k, 1]))] = heights[levels[k]] * normal
        return out

    def _bends(
        self, plane: Plane, start: LeadStart, straight: bool = True
    ) -> Iterator[PlanarRoute]:
        """Yield first bends to either side, continued straight until the pocket is a wall away."""
        corner = (start.mouth - start.ferrule * start.out - plane.origin) @ plane.axes[:, :2]
        x, y = (start.out @ plane.axes[:, :2]).tolist()
        heading, across = float(np.arctan2(y, x)), np.array([-y, x])
        for side in (1, -1):
            for turns in FIRST_BEND_MOVES:
                moves: tuple[int, ...] = (side,) * turns
                way = PlanarRoute(corner, heading, self.wires.bend, moves)
                while straight and len(moves) < 60:
                    aside = abs(float((way.arcs[-1, 2] - corner) @ across))
                    if aside >= start.radius + self._min_distance + CELL_MM:
                        break
                    moves = (*moves, 0)
                    way = PlanarRoute(corner, heading, self.wires.bend, moves)
                yield way

    def _is_clear(
        self, plane: Plane, way: PlanarRoute, other_trees: Sequence[tuple[Any, float]]
    ) -> bool:
        """Whether a route keeps its walls to the skin and to others' hollows."""
        points = plane.to_world(way.sample(SPACING_MM))
        points = outside_bay(points, self.wires.bay)
        if not len(points):
            return False
        clearance = self._min_distance - TOLERANCE_MM
        # It starts in the body and cannot pass through a skin that it keeps away from.
        if (self._depth(points) < clearance).any():
            return False
        return bool((_gap(points, other_trees, clearance) >= clearance).all())

    def _extend_to_skin(self, plane: Plane, way: PlanarRoute, start: LeadStart) -> Lead | None:
        """Extend a bend straight to the skin if that is near and apart from the mouth."""
        end = plane.to_world(way.arcs[-1, 2])
        out = _direction(plane, way)
        depth, run = surface_queries.find_exit(end, out, self._body, 2 * self.wires.diameter)
        if not 0 < depth <= MAX_SKIN_LEAD_MM:
            return None
        exit_ = end + depth * out
        if np.linalg.norm(exit_ - start.mouth) < start.flare + self._wall + self.wires.diameter:
            return None
        # The route has whole moves: the tool continues from the last one.
        count = int(depth / way.step)
        way = PlanarRoute(way.start, way.heading, way.radius, (*way.moves, *(0,) * count))
        return Lead(plane, way, exit_, run - count * way.step, to_bay=False)

    def _emerges(self, lead: Lead, other_trees: Sequence[tuple[Any, float]]) -> bool:
        """Whether a lead to the skin keeps its walls, which fade out where it emerges."""
        points = lead.inside
        remaining = arc_lengths(points[::-1])[::-1]
        needed = np.minimum(self._min_distance, MAX_EXIT_SLOPE * remaining) - TOLERANCE_MM
        if (self._depth(points) < needed).any():
            return False
        return bool(
            (
                _gap(points, other_trees, self._min_distance) >= self._min_distance - TOLERANCE_MM
            ).all()
        )


def _direction(plane: Plane, way: PlanarRoute) -> Float:
    angle = way.end_heading
    return np.asarray(plane.axes[:, :2] @ [np.cos(angle), np.sin(angle)])


def _gap(points: Float, trees: Sequence[tuple[Any, float]], max_distance: float) -> Float:
    """Return the distance (n,) of points (n, 3) from the nearest hollow, mm; infinite beyond
    `max_distance` mm.
    """
    out = np.full(len(points), np.inf)
    for tree, radius in trees:
        distance = tree.query(points, distance_upper_bound=radius + max_distance)[0]
        out = np.minimum(out, distance - radius)
    return out
