"""Channels for the wires: from the joint with the cord by a bend to the connector bay, or to the
skin beside the mouth.

A wire that leaves its pocket by a bend cannot pull its ferrule out: that is its strain relief. All
of it lies in the cord's plane, so that it is laid into the same open joint.
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
from ..bodies.connector_bay import in_solid, inside, without_bay
from ..kernels import surface_queries, triangle_kernel
from ..kernels.cutting_tools import Prism
from ..kernels.surface_queries import signed_distance_of
from .planar_routing import HEADINGS, Grid, Way, search

_SPACING = 0.25  # mm, between points of a lead
_CELL, _CELLS = 0.3, 400  # mm, of the grid that ways are sought on, and most of them across
#: A lead may come out at the skin as flat as this: depth gained per length.
SLOPE = 0.45
_WITHIN = 0.6  # mm, from the bay's walls to where a lead ends
_TOLERANCE = 0.02  # mm
_LONGEST = 15.0  # mm, of a lead to the skin
_DEEPEST = 25.0  # mm, of a hole from a plane to the bay
_TURNS = range(HEADINGS // 8, HEADINGS // 2 + 1)  # moves of the first bend: 45 to 180 degrees
_BEND = 2.0  # diameters of a wire's channel, the radius of its bends


#: Why a wire has no lead, if it cannot even leave its pocket.
NO_TURN = "there is not enough space for the bend of the wire"


@dataclass(frozen=True)
class Wires:
    """The diameters of the `wire` and its channel, mm, the connector `bay` or None, and whether
    wires that do not reach it come out of the skin by a bend (`relief`)."""

    wire: float
    diameter: float
    bay: Prism | None = None
    relief: bool = True

    @property
    def bend(self) -> float:
        """Radius of a bend, mm."""
        return _BEND * self.diameter

    def room(self, wall: float) -> float:
        """From the skin to a ferrule behind whose end the wire turns aside, mm."""
        return self.bend + self.diameter / 2 + wall


@dataclass(frozen=True)
class Lead:
    """A wire's channel in `plane` along a `way` and straight on to its `exit` (3,) mm in the bay or
    the skin; `run` is how far its tool goes on from the way's end, mm. Where the plane passes
    beside the bay, `drop` (3,) mm is the straight hole from there into it, along the normal."""

    plane: Plane
    way: Way
    exit: Float
    run: float
    to_bay: bool
    drop: Float | None = None

    @cached_property
    def inside(self) -> Float:
        """Its centre line (p, 3) mm in the plane, from the ferrule to its exit."""
        line = self.plane.to_world(self.way.sample(_SPACING))
        return line if self.to_bay else np.concatenate([line, self.exit[None]])

    @property
    def length(self) -> float:
        """From the ferrule to the exit, mm."""
        down = 0.0 if self.drop is None else float(np.linalg.norm(self.drop))
        return float(np.linalg.norm(np.diff(self.inside, axis=0), axis=1).sum()) + down

    @property
    def whole(self) -> Float:
        """Points (p, 3) mm along the centre line with its drop."""
        return self.inside if self.drop is None else np.concatenate([self.inside, self.hole])

    @property
    def hole(self) -> Float:
        """Points (q, 3) mm along the drop."""
        assert self.drop is not None
        count = int(np.linalg.norm(self.drop) / _SPACING) + 2
        return np.asarray(self.exit + np.linspace(0, 1, count)[:, None] * self.drop)

    @property
    def path(self) -> Float:
        """Its corners (p, 3) mm in the plane, from the ferrule to its exit."""
        line = self.plane.to_world(self.way.polyline)
        return line if self.to_bay else np.concatenate([line, self.exit[None]])

    @property
    def line(self) -> Float:
        """The tool's corners (p, 3) mm: along the way and its run."""
        line = self.plane.to_world(self.way.polyline)
        return np.concatenate([line, line[-1:] + self.run * self.out]) if self.run else line

    @property
    def out(self) -> Float:
        """Direction (3,) at its end."""
        return _direction(self.plane, self.way)


@dataclass(frozen=True)
class Pit:
    """The pocket that a lead begins in: its `mouth` (3,) mm, the unit direction `out` (3,), its
    `radius`, that of its mouth's chamfer, and how deep below its mouth the ferrule ends, mm."""

    mouth: Float
    out: Float
    radius: float
    flare: float
    ferrule: float


#: Points (n, 3) mm along what is hollow, and the radius around them.
Hollow = tuple[Float, float]


class Router:
    """Finds room for leads in one body."""

    def __init__(self, body: Surface, wires: Wires, wall: float) -> None:
        self.wires, self._wall, self._body = wires, wall, body
        self._skin = without_bay(body, wires.bay) if wires.bay else body
        self._depth = signed_distance_of(self._skin).unsigned
        self._grids: dict[int, tuple[Float, float, Float, Any]] = {}

    def to_bay(
        self, plane: Plane, pit: Pit, own: Sequence[Hollow], others: Sequence[Hollow]
    ) -> Lead | str:
        """A lead from the pit to the bay, or why there is none; `own` are all hollows of its cord,
        `others` those that it keeps away from all along."""
        away = self._trees(others)
        begun = [w for w in self._bends(plane, pit) if self._clear(plane, w, away)]
        if not begun:
            return NO_TURN
        low, cell, skin, bay = self._grid(plane)
        near = self._trees(own)
        solid = ~bay & (skin > 0)
        cells = plane.to_world(low + cell * np.argwhere(solid))
        room = skin.copy()
        gaps = _gap(cells, [*near, *away], self._least + 2 * cell) - self._least
        room[solid] = np.minimum(skin[solid], gaps)
        drops: dict[tuple[int, int], Float] = {}
        goal = bay
        if not bay.any():
            drops = self._drops(plane, low, cell, room, [*near, *away])
            goal = np.zeros_like(bay)
            if not drops:
                return "its plane passes too far from the connector bay"
            goal[tuple(np.array(list(drops)).T)] = True
        grid = Grid(low, cell, room, goal)
        way = search(begun, grid)
        if way is None:
            return "no route in its plane to the connector bay keeps the walls"
        x, y = way.arcs[-1, 2].tolist()
        drop = drops.get(grid.cell_of(x, y) or (-1, -1))
        # Above a hole the groove goes on to the hole's far wall (nearly: kernels fail on tangents).
        run = 0.0 if drop is None else 0.45 * self.wires.diameter
        lead = Lead(plane, way, plane.to_world(way.arcs[-1, 2]), run, to_bay=True, drop=drop)
        return (
            lead
            if self._clear(plane, way, away)
            else "the route to the connector bay does not keep the walls"
        )

    def to_skin(self, plane: Plane, pit: Pit, others: Sequence[Hollow]) -> Lead | str:
        """The shortest lead from the pit by a bend to the skin beside its mouth, or why there is
        none."""
        away = self._trees(others)
        found = []
        for way in self._bends(plane, pit, straight=False):
            lead = self._out(plane, way, pit)
            if lead is not None and self._emerges(lead, away):
                found.append(lead)
        return min(found, key=lambda w: w.way.length) if found else NO_TURN

    def _trees(self, hollows: Sequence[Hollow]) -> list[tuple[Any, float]]:
        """The hollows in the solid, ready to be searched."""
        solid = [(in_solid(points, self.wires.bay), radius) for points, radius in hollows]
        return [(cKDTree(points), radius) for points, radius in solid if len(points)]

    @property
    def _least(self) -> float:
        return self.wires.diameter / 2 + self._wall

    def _grid(self, plane: Plane) -> tuple[Float, float, Float, Any]:
        """Cells of the plane: the lower corner, their size, room to the skin beyond a lead's wall
        (below zero outside) and whether they are in the bay."""
        if id(plane) not in self._grids:
            flat = (self._body.vertices - plane.origin) @ plane.axes[:, :2]
            low, high = flat.min(axis=0), flat.max(axis=0)
            cell = max(_CELL, float((high - low).max()) / _CELLS)
            nx, ny = (np.ceil((high - low) / cell).astype(int) + 1).tolist()
            cells = np.indices((nx, ny)).reshape(2, -1).T
            points = np.ascontiguousarray(plane.to_world(low + cell * cells))
            bay = self.wires.bay
            assert bay is not None
            goal, within = inside(points, bay, _WITHIN), inside(points, bay)
            room = np.full(len(points), -1.0)
            free = self._section(plane, low, cell, (nx, ny)).ravel() | within
            room[free] = self._depth(points[free]) - self._least
            self._grids[id(plane)] = (low, cell, room.reshape(nx, ny), goal.reshape(nx, ny))
        return self._grids[id(plane)]

    def _section(self, plane: Plane, low: Float, cell: float, shape: tuple[int, int]) -> Bool:
        """Which cells' middles lie in the body: every crossing of an outline with a row of cells
        turns the rest of the row over."""
        into = np.column_stack([plane.axes.T, -plane.axes.T @ plane.origin])
        turned = np.zeros(shape, int)
        body = triangle_kernel.to_manifold(self._body, "the body")
        for outline in body.transform(into).slice(0.0).to_polygons():
            a = (np.asarray(outline, float) - low) / cell
            for (x0, y0), (x1, y1) in zip(a, np.roll(a, -1, axis=0), strict=True):
                rows = np.arange(np.ceil(min(y0, y1)), np.ceil(max(y0, y1)))
                rows = rows[(rows >= 0) & (rows < shape[1])]
                x = np.ceil(x0 + (rows - y0) / (y1 - y0) * (x1 - x0)) if len(rows) else rows
                np.add.at(turned, (np.clip(x, 0, shape[0] - 1).astype(int), rows.astype(int)), 1)
        return np.asarray(turned.cumsum(axis=0) % 2 == 1)

    def _drops(
        self, plane: Plane, low: Float, cell: float, room: Float, near: Sequence[tuple[Any, float]]
    ) -> dict[tuple[int, int], Float]:
        """From which cells a straight hole along the plane's normal reaches the bay and keeps its
        walls, and the hole (3,) mm."""
        bay = self.wires.bay
        assert bay is not None
        cells = np.argwhere(room > cell)
        foot = plane.to_world(low + cell * cells)
        heights = np.arange(0.0, _DEEPEST, _SPACING)
        least = self._least + cell  # a way ends in a cell, not in its middle
        out: dict[tuple[int, int], Float] = {}
        for normal in (plane.normal, -plane.normal):
            reached = np.full(len(cells), -1)
            for k in range(len(heights))[::-1]:
                reached[inside(foot + heights[k] * normal, bay, _WITHIN)] = k
            which = np.repeat(np.arange(len(cells)), reached + 1)
            height = np.concatenate([heights[: k + 1] for k in reached] or [heights[:0]])
            line = foot[which] + height[:, None] * normal
            solid = ~inside(line, bay)
            room_there = np.minimum(self._depth(line[solid]), _gap(line[solid], near, least))
            blocked = which[solid][room_there < least]
            for k in np.setdiff1d(np.flatnonzero(reached >= 0), blocked):
                out[(int(cells[k, 0]), int(cells[k, 1]))] = heights[reached[k]] * normal
        return out

    def _bends(self, plane: Plane, pit: Pit, straight: bool = True) -> Iterator[Way]:
        """First bends to either side, and straight on from there until the pit is a wall away."""
        start = (pit.mouth - pit.ferrule * pit.out - plane.origin) @ plane.axes[:, :2]
        x, y = (pit.out @ plane.axes[:, :2]).tolist()
        heading, across = float(np.arctan2(y, x)), np.array([-y, x])
        for side in (1, -1):
            for turns in _TURNS:
                moves: tuple[int, ...] = (side,) * turns
                way = Way(start, heading, self.wires.bend, moves)
                while straight and len(moves) < 60:
                    aside = abs(float((way.arcs[-1, 2] - start) @ across))
                    if aside >= pit.radius + self._least + _CELL:
                        break
                    moves = (*moves, 0)
                    way = Way(start, heading, self.wires.bend, moves)
                yield way

    def _clear(self, plane: Plane, way: Way, away: Sequence[tuple[Any, float]]) -> bool:
        """Whether a way keeps its walls to the skin and to others' hollows."""
        points = plane.to_world(way.sample(_SPACING))
        points = in_solid(points, self.wires.bay)
        if not len(points):
            return False
        least = self._least - _TOLERANCE
        # It begins in the body and cannot step through a skin that it keeps away from.
        if (self._depth(points) < least).any():
            return False
        return bool((_gap(points, away, least) >= least).all())

    def _out(self, plane: Plane, way: Way, pit: Pit) -> Lead | None:
        """A bend that goes straight on to the skin, where that is not far and apart from the
        mouth."""
        end = plane.to_world(way.arcs[-1, 2])
        out = _direction(plane, way)
        depth, run = surface_queries.find_exit(end, out, self._body, 2 * self.wires.diameter)
        if not 0 < depth <= _LONGEST:
            return None
        exit_ = end + depth * out
        if np.linalg.norm(exit_ - pit.mouth) < pit.flare + self._wall + self.wires.diameter:
            return None
        # The way is in whole moves: the tool runs on from the last of them.
        count = int(depth / way.step)
        way = Way(way.start, way.heading, way.radius, (*way.moves, *(0,) * count))
        return Lead(plane, way, exit_, run - count * way.step, to_bay=False)

    def _emerges(self, lead: Lead, away: Sequence[tuple[Any, float]]) -> bool:
        """Whether a lead to the skin keeps its walls, fading out where it comes out."""
        points = lead.inside
        left = arc_lengths(points[::-1])[::-1]
        needed = np.minimum(self._least, SLOPE * left) - _TOLERANCE
        if (self._depth(points) < needed).any():
            return False
        return bool((_gap(points, away, self._least) >= self._least - _TOLERANCE).all())


def _direction(plane: Plane, way: Way) -> Float:
    angle = way.end_heading
    return np.asarray(plane.axes[:, :2] @ [np.cos(angle), np.sin(angle)])


def _gap(points: Float, trees: Sequence[tuple[Any, float]], most: float) -> Float:
    """Distance (n,) mm of points (n, 3) from the nearest hollow; infinite beyond `most` mm."""
    out = np.full(len(points), np.inf)
    for tree, radius in trees:
        away = tree.query(points, distance_upper_bound=radius + most)[0]
        out = np.minimum(out, away - radius)
    return out
