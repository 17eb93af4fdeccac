"""Compute the signals of cords that the simulated fields move, and their derivatives.

Points are located in their tets and moved by all states at once. `sensing/response.py` defines the
signal, and `cord_loops.py` has the compiled loops.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...mechanics.elements.point_location import PointLocator, locate_along_path
from ...mechanics.elements.threads import count_cores, run_in_chunks
from ...sensing.built_cord import TraceSection
from ...sensing.response import Response
from .cord_loops import (
    Lines,
    Tets,
    carry_lines,
    fill_signals,
    fill_slopes,
    move_points,
    pull_signals,
)

_CHUNK_PATHS = 50  # fewer are not worth a thread


@dataclass(frozen=True)
class SignalModel:
    """How a cord senses: the signal L w / sqrt((L + series)^2 + contact^2).

    L is the rest length of the strained middle part of the path, and w its relative resistance
    change. The division gives all signals the same noise, that of a very long cord (see
    `sensing/built_cord.py`). Of a printed trace, L is the length of a level trace of the same
    resistance, and each segment counts in w by its resistance.

    Attributes:
        response: Response w of the cord to strain.
        local: Whether w is the mean of the responses to the segments' strains, rather than the
            response to the mean strain.
        hidden: Length at each end that is not strained because it lies in a pocket, mm.
        series: Length of cord that conducts but is not strained, mm.
        contact: Length of a cord whose noise of (R - R0)/R0 equals the noise that the joints add,
            mm.
        section: Cross-section of printed traces, none of which is hidden; None for cords.
    """

    response: Response
    local: bool = False
    hidden: float = 0.0
    series: float = 0.0
    contact: float = 0.0
    section: TraceSection | None = None


class CordCarrier:
    """Moves points and cords by all fields at once.

    The nodes' deformed positions (n, 3 s) are interpolated. This is exact, because quadratic shape
    functions reproduce linear fields such as the rest positions.

    Args:
        locator: Locator of the mesh.
        fields: Displacements (s, n, 3) mm of its nodes in s states.
        model: How cords sense.

    Attributes:
        states: Number of states.
        bent: Whether the strained length has derivatives other than 0 and 1 by its segments.
        answer: The signal model as the compiled loops take it.
        tets: The mesh in all states.
    """

    def __init__(self, locator: PointLocator, fields: Float, model: SignalModel) -> None:
        self.states = len(fields)
        response = model.response
        is_linear = response.linear_slope is not None  # only the mean strain then matters
        self._local = model.local and not is_linear
        self._is_trace = model.section is not None
        self.bent = self._local or model.hidden > 0 or self._is_trace
        section = np.zeros(0) if model.section is None else model.section.values
        table = (response.breaks, response.origins, response.pieces, section)
        self.answer = (self._local, model.hidden, model.series, model.contact**2, *table)
        mesh = locator.mesh
        self._where = (locator.grid, locator.opposite_tets)
        placed = (mesh.nodes + fields).transpose(1, 2, 0)
        nodal = np.ascontiguousarray(placed).reshape(len(placed), -1)
        self.tets = Tets(mesh.cells, mesh.bary_gradient, nodal)

    def signals(self, paths: Float) -> Float:
        """Return the signals (s, c) of polylines (c, p, 3) mm."""
        paths = np.ascontiguousarray(paths, float)
        out = np.empty((len(paths), self.states))

        def work(a: int, b: int) -> None:
            fill_signals(paths[a:b], self._where, self.tets, self.answer, out[a:b])

        run_in_chunks(work, len(paths), count_cores(), _CHUNK_PATHS)
        return np.ascontiguousarray(out.T)

    def move(self, points: Float) -> Float:
        """Return the deformed positions (s, p, 3) mm of points (p, 3) mm."""
        points = np.ascontiguousarray(points, float)
        out = np.empty((len(points), 3 * self.states))

        def work(a: int, b: int) -> None:
            cell, bary = np.empty(b - a, np.int64), np.empty((b - a, 4))
            locate_along_path(points[a:b], *self._where, cell, bary)
            move_points(cell, bary, self.tets, out[a:b])

        run_in_chunks(work, len(points), count_cores(), 40 * _CHUNK_PATHS)
        return np.ascontiguousarray(out.reshape(len(points), 3, -1).transpose(2, 0, 1))

    def carry(self, points: Float, ends: Int) -> CarriedCords:
        """Move several polylines by all states.

        Args:
            points: Points (p, 3) mm of all lines, one line after the other.
            ends: (m + 1,) numbers; line i has the points `ends[i]` to `ends[i + 1]`.
        """
        count = len(points)
        lines = Lines(
            np.empty(count, np.int64),
            np.empty((count, 4)),
            np.empty((count, 3 * self.states)),
            np.empty((count, self.states)),
            np.empty((len(ends) - 1, 3, self.states)),
            np.empty((2, count if self.bent else 0, self.states)),
            np.empty((count if self._is_trace else 0, 4)),
        )
        carry_lines(points, ends, self._where, self.tets, self.answer, lines)
        return CarriedCords(self.tets, points, ends, lines)


class CarriedCords:
    """Polylines in all states, with their signals and derivatives.

    Args:
        tets: The mesh in all states.
        points: Points (p, 3) mm of all lines.
        ends: (m + 1,) ranges of the lines' points.
        lines: The lines in all states.

    Attributes:
        signals: (s, m), signals of the lines.
    """

    def __init__(self, tets: Tets, points: Float, ends: Int, lines: Lines) -> None:
        self._tets, self._points, self._ends, self._lines = tets, points, ends, lines
        self.signals = lines.signals[:, 0].T

    def slopes(self) -> Float:
        """Return the derivatives (p, 3, s) of each line's signals by its points."""
        out = np.empty((len(self._points), 3, self._lines.steps.shape[1]))
        fill_slopes(self._points, self._ends, self._tets, self._lines, out)
        return out

    def pull(self, by_signals: Float) -> Float:
        """Return a value's derivatives (p, 3) by the points from those (s, m) by the signals."""
        out = np.empty_like(self._points)
        by_signals = np.ascontiguousarray(by_signals)
        pull_signals(self._points, self._ends, self._tets, by_signals, self._lines, out)
        return out
