"""Conductive traces as center lines with a rectangular cross-section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...core.arrays import Float, Int

_SPACING_MM = 0.1  # of the points on a center line to which cells are assigned


@dataclass(frozen=True)
class Trace:
    """Conductor that is printed in a body.

    Attributes:
        name: Name for messages.
        points: Center line (p, 3), mm, in the print's frame.
        width: Size of the cross-section across the center line, level with the bed, mm.
        height: Size of the cross-section across the center line and its width, mm.
        terminals: Positions (2, 3) of both contacts, mm; by default the ends of the center line.

    Raises:
        ValueError: A shape or a size is invalid.
    """

    name: str
    points: Float
    width: float
    height: float
    terminals: Float | None = None

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3 or len(self.points) < 2:
            raise ValueError("points: must have the shape (p, 3) with p > 1")
        if not np.isfinite(self.points).all():
            raise ValueError("points: must be finite")
        if not (self.width > 0 and self.height > 0):
            raise ValueError("width, height: must be positive")
        if self.terminals is not None and self.terminals.shape != (2, 3):
            raise ValueError("terminals: must have the shape (2, 3)")

    @property
    def ends(self) -> Float:
        """Positions (2, 3) of both contacts, mm."""
        return self.points[[0, -1]] if self.terminals is None else self.terminals

    @property
    def area(self) -> float:
        """Cross-section, mm^2."""
        return self.width * self.height

    def move(self, shift: Float) -> Trace:
        """Return the trace moved by `shift` (3,), mm."""
        terminals = None if self.terminals is None else self.terminals + shift
        return replace(self, points=self.points + shift, terminals=terminals)


@dataclass(frozen=True)
class Places:
    """Where points are relative to traces.

    Attributes:
        trace: Indices (n,) of the nearest traces, -1 if far from all.
        arc: Positions (n,) along the center lines, mm.
        side: Distances (n,) from the center lines along the width, mm.
        rise: Distances (n,) along the height, mm.
        beyond: Distances (n,) beyond the ends of the center lines, mm; 0 between the ends.
    """

    trace: Int
    arc: Float
    side: Float
    rise: Float
    beyond: Float


@dataclass(frozen=True)
class _Line:
    """Center line with close points, and its frames."""

    points: Float
    arc: Float
    tangent: Float
    side: Float
    up: Float


def locate(points: Float, traces: Sequence[Trace], margin: float) -> Places:
    """Return where points are relative to the traces.

    Args:
        points: Points (n, 3), mm.
        traces: Traces.
        margin: Distance from the surfaces of the traces up to which points are assigned, mm.
    """
    n = len(points)
    best = np.full(n, np.inf)
    places = Places(np.full(n, -1), *(np.zeros(n) for _ in range(4)))
    for k, trace in enumerate(traces):
        line = _resample(trace)
        reach = float(np.hypot(trace.width / 2 + margin, trace.height / 2 + margin)) * 1.01
        reach += _SPACING_MM
        low, high = line.points.min(axis=0) - reach, line.points.max(axis=0) + reach
        near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
        distance, index = cKDTree(line.points).query(points[near], distance_upper_bound=reach)
        near, index = near[np.isfinite(distance)], index[np.isfinite(distance)]
        offset = points[near] - line.points[index]
        along = (offset * line.tangent[index]).sum(axis=1)
        last = len(line.points) - 1
        beyond = np.where(index == 0, np.maximum(-along, 0), 0.0)
        beyond = np.where(index == last, np.maximum(along, 0), beyond)
        rise = (offset * line.up[index]).sum(axis=1)
        inner = np.clip(along, -_SPACING_MM, _SPACING_MM)
        arc = np.clip(line.arc[index] + inner, 0, line.arc[-1])
        # Outside a corner, what is left along the tangent counts as distance to the side.
        rest = np.where(beyond > 0, 0.0, np.maximum(np.abs(along) - _SPACING_MM, 0.0))
        side = np.hypot((offset * line.side[index]).sum(axis=1), rest)
        score = np.maximum(side / trace.width, np.abs(rise) / trace.height)
        score += beyond / min(trace.width, trace.height)
        better = score < best[near]
        chosen = near[better]
        best[chosen], places.trace[chosen] = score[better], k
        values = (arc, side, np.abs(rise), beyond)
        for target, value in zip(
            (places.arc, places.side, places.rise, places.beyond), values, strict=True
        ):
            target[chosen] = value[better]
    return places


def find_arcs(points: Float, trace: Trace) -> Float:
    """Return the positions (n,) along a center line, mm, that are nearest to points (n, 3)."""
    line = _resample(trace)
    index = cKDTree(line.points).query(points)[1]
    along = ((points - line.points[index]) * line.tangent[index]).sum(axis=1)
    inner = np.clip(along, -_SPACING_MM, _SPACING_MM)
    return np.asarray(np.clip(line.arc[index] + inner, 0, line.arc[-1]))


def find_terminal_arcs(trace: Trace) -> tuple[float, float]:
    """Return the positions of both terminals along the center line, mm, in ascending order."""
    line = _resample(trace)
    if trace.terminals is None:
        return 0.0, float(line.arc[-1])
    index = cKDTree(line.points).query(trace.terminals)[1]
    first, second = sorted(float(v) for v in line.arc[index])
    return first, second


def point_at(trace: Trace, arc: float) -> Float:
    """Return the point (3,) of the center line at a position along it, mm."""
    line = _resample(trace)
    return np.array([np.interp(arc, line.arc, line.points[:, i]) for i in range(3)])


def _resample(trace: Trace) -> _Line:
    step = np.linalg.norm(np.diff(trace.points, axis=0), axis=1)
    kept = np.append(True, step > 1e-9)
    points, corner = trace.points[kept], np.append(0.0, np.cumsum(step[kept[1:]]))
    count = max(2, int(np.ceil(corner[-1] / _SPACING_MM)) + 1)
    arc = np.linspace(0, corner[-1], count)
    fine = np.stack([np.interp(arc, corner, points[:, i]) for i in range(3)], axis=1)
    tangent = np.gradient(fine, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    side = np.cross(tangent, [0.0, 0.0, 1.0])
    norm = np.linalg.norm(side, axis=1, keepdims=True)
    side = np.where(norm > 1e-6, side / np.maximum(norm, 1e-6), np.array([0.0, -1.0, 0.0]))
    up = np.cross(side, tangent)
    return _Line(fine, arc, tangent, side, up)
