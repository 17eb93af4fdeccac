"""Move cords that break a limit as little as possible, so that they keep all of them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.curve import (
    Hermite,
    Plane,
    catmull_rom,
    is_smooth,
    per_span_for_signal,
    sample_path,
)
from ...core.device.device import PLANE_FREEDOMS, Sensor
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import SignedDistance, signed_distance_of
from ..limits.verification import LayoutCheck, LimitViolation, verify
from ..limits.worsening import worsened_limits
from ..problem.cord_parameters import effective_freedom, round_layout
from ..problem.problem import Limits
from ..search.starting_layouts import Layout
from .descent import MAX_MARGIN_USE_MM
from .path_in_body import ends_at_surface, pull_into_body, refitted_paths
from .repair_program import RepairProgram
from .sqp import minimize

_ITERATIONS = 40
_ROUNDS = 3  # descents in a row, as only a new one measures the inlets again
_PASSES = 2  # over all cords, as one cord may make room for another
_TOLERANCE = 1e-3  # smallest relative gain per iteration
_DECIMALS, _DIRECTION_DECIMALS = 3, 6  # of device.toml


@dataclass(frozen=True)
class Repair:
    """The result of a repair.

    Attributes:
        sensors: The layout, in which no limit is worse than before.
        moves: How far each changed cord moved at most, mm, by name.
        remaining: Limits that cords to be repaired still break.
        check: The layout's numbers.
        is_complete: Whether the repair ended before its time was over.
    """

    sensors: Layout
    moves: Mapping[str, float]
    remaining: tuple[LimitViolation, ...]
    check: LayoutCheck
    is_complete: bool

    @property
    def unrepaired(self) -> tuple[str, ...]:
        """Names of the cords that still break a limit."""
        return tuple(dict.fromkeys(name for v in self.remaining for name in v.cords))


def repair_layout(
    sensors: Sequence[Sensor],
    surface: Surface,
    limits: Limits,
    *,
    names: Collection[str] | None = None,
    keeps_freedoms: bool = False,
    depth: SignedDistance | None = None,
    check_wanted: Callable[[], None] = lambda: None,
    limit_s: float = math.inf,
) -> Repair:
    """Repair the cords that break a limit; the others stay as they are.

    Each cord is repaired next to the others, from its own path or else from one that is fitted
    again, then all of them together. Cords stay in their planes unless only another plane helps.

    Args:
        sensors: All cords of the layout.
        surface: The body's surface.
        limits: The limits.
        names: Names of the cords that may move; None for all.
        keeps_freedoms: Whether only that moves of them which a search may move, rather than path,
            ends and plane.
        depth: Depth below the surface, computed if not given.
        check_wanted: Called often; what it raises ends the repair.
        limit_s: Time after which the cords that were not reached stay as they are, s.
    """
    depth = depth or signed_distance_of(surface)
    end = time.monotonic() + limit_s

    def check_time() -> None:
        check_wanted()
        if time.monotonic() > end:
            raise _TimeIsOver

    repairer = _Repairer(surface, limits, depth, keeps_freedoms, check_time)
    return repairer.repair(tuple(sensors), names)


class _TimeIsOver(Exception):
    """Ends a repair with what it has found."""


class _Repairer:
    """Repairs layouts in one body."""

    def __init__(
        self,
        surface: Surface,
        limits: Limits,
        depth: SignedDistance,
        keeps_freedoms: bool,
        check_wanted: Callable[[], None],
    ) -> None:
        self._surface, self._limits, self._depth = surface, limits, depth
        self._keeps_freedoms, self._check_wanted = keeps_freedoms, check_wanted

    def repair(self, sensors: Layout, names: Collection[str] | None) -> Repair:
        before = verify(sensors, self._surface, self._limits, self._depth)
        movable = [s.name for s in sensors if names is None or s.name in names]
        best, is_complete = (sensors, before), True
        try:
            for best in self._improve(sensors, before, movable):
                if not _broken(best[1], movable):
                    break
        except _TimeIsOver:
            is_complete = False
        layout, check = best
        moves = {
            new.name: _distance(old, new)
            for old, new in zip(sensors, layout, strict=True)
            if new is not old
        }
        remaining = tuple(v for v in check.violations if set(v.cords) & set(movable))
        return Repair(layout, moves, remaining, check, is_complete)

    def _improve(
        self, layout: Layout, check: LayoutCheck, movable: Sequence[str]
    ) -> Iterator[tuple[Layout, LayoutCheck]]:
        """Yield layouts, each better than the one before or the same."""
        for _ in range(_PASSES):
            for name in _broken(check, movable):
                if name in _broken(check, movable):  # another cord may have made room meanwhile
                    layout, check = self._repair_cord(layout, check, name)
                    yield layout, check
            broken = _broken(check, movable)
            if len(broken) > 1:
                layout, check = self._repair_together(layout, check, broken)
                yield layout, check

    def _repair_cord(
        self, layout: Layout, check: LayoutCheck, name: str
    ) -> tuple[Layout, LayoutCheck]:
        """Return the layout with one cord repaired as far as possible."""
        k = [s.name for s in layout].index(name)
        best = layout, check
        for start, free in self._starts(layout[k], self._freedom(layout[k], layout)):
            trial = (*layout[:k], start, *layout[k + 1 :])
            found = self._descend(trial, {name: free})
            checked = self._check(found)
            if worsened_limits(check, checked, self._limits):
                continue
            if not _broken(checked, [name]):
                return found, checked
            if len(checked.violations) < len(best[1].violations):
                best = found, checked
        return best

    def _freedom(self, sensor: Sensor, layout: Layout) -> frozenset[str]:
        """Return what may move of a cord; as in a search, its ends are free if its plane is.

        With the freedoms of a search, a plane that several cords share stays, and so they share it.
        """
        if not self._keeps_freedoms:
            return frozenset({"path", "ends", *({"plane"} if sensor.curve.is_planar else ())})
        free = effective_freedom(sensor, layout)
        plane = PLANE_FREEDOMS & free
        if not plane or not sensor.curve.is_planar:
            return free
        others = (s for s in layout if s.name != sensor.name and s.curve.is_planar)
        is_shared = any(s.plane.coincides(sensor.plane) for s in others)
        return frozenset({"path", "ends"} if is_shared else {"path", "ends", *plane})

    def _starts(
        self, sensor: Sensor, free: frozenset[str]
    ) -> Iterator[tuple[Sensor, frozenset[str]]]:
        """Yield paths to repair a cord from, and what may move of it, the nearest first."""
        has_free_ends = "ends" in free
        starts = []
        if has_free_ends:
            starts = list(refitted_paths(sensor, self._surface, self._depth))
        if ends_at_surface(sensor, self._surface, self._depth) or not starts:
            starts.insert(0, sensor)
        for start in starts:
            yield start, free - PLANE_FREEDOMS
        if not has_free_ends:
            return
        if "offset" not in free:
            pulled = pull_into_body(sensor, self._depth)
            starts += refitted_paths(pulled, self._surface, self._depth)
        for start in starts:
            yield start, free

    def _repair_together(
        self, layout: Layout, check: LayoutCheck, names: Sequence[str]
    ) -> tuple[Layout, LayoutCheck]:
        freedoms = {s.name: self._freedom(s, layout) for s in layout if s.name in names}
        in_planes = {name: free - PLANE_FREEDOMS for name, free in freedoms.items()}
        for trial in (in_planes, freedoms):
            found = self._descend(layout, trial)
            checked = self._check(found)
            is_better = len(checked.violations) < len(check.violations)
            if is_better and not worsened_limits(check, checked, self._limits):
                layout, check = found, checked
            if not _broken(check, names):
                break
        return layout, check

    def _descend(self, layout: Layout, freedoms: Mapping[str, frozenset[str]]) -> Layout:
        """Return the nearest layout that keeps the limits as the descents see them."""
        target = layout
        for n in range(_ROUNDS):
            program = RepairProgram(
                self._surface,
                self._depth,
                self._limits,
                layout,
                target,
                freedoms,
                self._check_wanted,
            )
            loosest = MAX_MARGIN_USE_MM if n == 0 else 0.0
            start = np.zeros(program.size)
            found = minimize(program, start, _ITERATIONS, tolerance=_TOLERANCE, loosest=loosest)
            layout = tuple(
                self._round(s) if s.name in freedoms else old
                for s, old in zip(program.layout(found.x), layout, strict=True)
            )
            if not _broken(self._check(layout), freedoms):
                break
        return layout

    def _round(self, sensor: Sensor) -> Sensor:
        """Round what has moved as a search does, or the cord as `device.toml` does."""
        return round_layout((sensor,))[0] if self._keeps_freedoms else _round(sensor)

    def _check(self, layout: Layout) -> LayoutCheck:
        self._check_wanted()
        return verify(layout, self._surface, self._limits, self._depth)


def _broken(check: LayoutCheck, names: Collection[str]) -> list[str]:
    """Return those of the names whose cords break a limit."""
    broken = {name for v in check.violations for name in v.cords}
    return [name for name in names if name in broken]


def _distance(old: Sensor, new: Sensor) -> float:
    """Return the largest distance (mm) of a path from where it was."""
    a = sample_path(old, per_span_for_signal(old.curve))
    b = sample_path(new, per_span_for_signal(new.curve))
    return float(np.linalg.norm(b[:, None] - a, axis=2).min(axis=1).max())


def _round(sensor: Sensor) -> Sensor:
    """Round a cord as `device.toml` does."""
    points = np.round(sensor.curve.points, _DECIMALS)
    tangents = np.round(sensor.curve.tangents, _DECIMALS)
    curve = Hermite(points, catmull_rom(points) if is_smooth(sensor.curve) else tangents)
    if not curve.is_planar:
        return replace(sensor, curve=curve)
    axes = np.round(sensor.plane.axes, _DIRECTION_DECIMALS)
    plane = Plane.from_normal(np.round(sensor.plane.origin, _DECIMALS), axes[:, 2], axes[:, 0])
    return replace(sensor, curve=curve, plane=plane)
