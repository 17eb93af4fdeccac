"""Compiled loops behind the objective and the candidates: cords in all states, and derivatives.

The derivatives of signals by the rest positions of points are gathered without forming deformation
gradients. States are the innermost index. The loops are in `kernels/cords.c` and
`kernels/cord_slopes.c`; they take whole paths because passing an array costs as much as a point.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...core.arrays import Float, Int
from ...core.machine import kernels


class Tets(NamedTuple):
    """A mesh in all states, for compiled loops.

    Attributes:
        cells: (m, 10) nodes of the tets.
        by_bary: (m, 4, 3) gradients of the barycentric coordinates.
        nodal: (n, 3 s) mm, deformed positions of the nodes.
    """

    cells: Int
    by_bary: Float
    nodal: Float


class Lines(NamedTuple):
    """Polylines of p points in all states, as `carry_lines` fills them.

    Attributes:
        cell: (p,) tets of the points.
        bary: (p, 4) their barycentric coordinates.
        moved: (p, 3 s) mm, deformed positions.
        steps: (p, s) mm, deformed lengths of the segments that end at the points.
        signals: (m, 3, s), signals of the lines and their derivatives by strained and rest length.
        bent: (2, p, s) derivatives of the strained lengths by segments, or empty.
        conduction: (p, 4), how the segments of printed traces that end at the points conduct: their
            relative resistance per length, and derivatives of their conducting lengths. Empty for
            cords.
    """

    cell: Int
    bary: Float
    moved: Float
    steps: Float
    signals: Float
    bent: Float
    conduction: Float


#: Where points are: the `grid` and the `opposite_tets` of a `PointLocator`.
Where = tuple[Any, Int]
#: How cords sense: local, hidden, series, contact squared, the response's arrays, and the values of
#: a trace's section, empty for cords.
Answer = tuple[bool, float, float, float, Float, Float, Float, Float]


def move_points(cell: Int, bary: Float, tets: Tets, out: Float) -> None:
    """Fill the deformed positions of points.

    Args:
        cell: Tets (p,) of the points.
        bary: Their barycentric coordinates (p, 4).
        tets: The mesh in all states.
        out: Result (p, 3 s), mm.
    """
    kernels.move_points(cell, bary, tets.cells, tets.nodal, out)


def fill_signals(paths: Float, where: Where, tets: Tets, answer: Answer, out: Float) -> None:
    """Fill the signals of many paths.

    Args:
        paths: Polylines (c, p, 3), mm.
        where: Where points are.
        tets: The mesh in all states.
        answer: How cords sense.
        out: Result (c, s).
    """
    kernels.fill_signals(paths, where, tets, answer, out)


def carry_lines(
    points: Float, ends: Int, where: Where, tets: Tets, answer: Answer, lines: Lines
) -> None:
    """Fill the states of lines.

    Args:
        points: Points (p, 3) mm of all lines.
        ends: Numbers (m + 1,); line i has the points `ends[i]` to `ends[i + 1]`.
        where: Where points are.
        tets: The mesh in all states.
        answer: How cords sense.
        lines: Filled for all points and lines.
    """
    kernels.carry_lines(points, ends, where, tets, answer, lines)


def fill_slopes(points: Float, ends: Int, tets: Tets, lines: Lines, out: Float) -> None:
    """Fill the derivatives of each line's signals by its points.

    Args:
        points: Points (p, 3) mm, as in `carry_lines`.
        ends: Ranges (m + 1,) of the lines' points.
        tets: The mesh in all states.
        lines: The lines in all states.
        out: Result (p, 3, s).
    """
    kernels.fill_slopes(points, ends, tets, lines, out)


def pull_signals(
    points: Float, ends: Int, tets: Tets, by_signals: Float, lines: Lines, out: Float
) -> None:
    """Fill the derivatives by the points of a value that depends on the signals.

    Args:
        points: Points (p, 3) mm, as in `carry_lines`.
        ends: Ranges (m + 1,) of the lines' points.
        tets: The mesh in all states.
        by_signals: Derivatives (s, m) of the value by the signals.
        lines: The lines in all states.
        out: Result (p, 3): `fill_slopes` times `by_signals`.
    """
    kernels.pull_signals(points, ends, tets, by_signals, lines, out)
