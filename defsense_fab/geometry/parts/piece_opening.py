"""Open a piece of a body along a plane, for the cords that run in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import MIN_PIECE_MM3, Prism

THREAD_DIAMETER_MM = 0.05  # diameter of the tube that represents a cord
MAX_COVER_MM2 = 0.1  # by which parts may cover each other and still come apart
#: Overlaps of solids that are joined, as faces that only touch can stay separate. The largest is
#: used that does not join solids on both sides of the cut.
OVERLAPS_MM = (1e-2, 1e-3, 1e-4)


def make_thread(lines: Sequence[Float], normal: Float) -> Any:
    """Return thin tubes along lines (p, 3) in a plane with this unit normal (3,)."""
    return triangle_kernel.union(
        [triangle_kernel.tube(x, normal, THREAD_DIAMETER_MM, sides=4) for x in lines]
    )


def solids_of(solid: Any) -> list[Any]:
    """Return the separate solids of one, without crumbs."""
    return [p for p in solid.decompose() if p.volume() > MIN_PIECE_MM3]


def runs_in(thread: Any, piece: Any) -> bool:
    """Return whether a thread runs in a piece."""
    return float((piece ^ thread).volume()) > 0.1 * THREAD_DIAMETER_MM**2


@dataclass(frozen=True)
class Halves:
    """A way to open a piece along a plane; of two equal ones that with the lower `rank` is
    taken.
    """

    below: list[Any]
    above: list[Any]
    rank: float
    taken: tuple[Any, ...] = ()
    by: tuple[Prism, Prism] | None = None
    gap: Any = None


@dataclass(frozen=True)
class OpenedPiece:
    """A piece (stored, so that its identity stays unique) that may be opened along a plane.

    Attributes:
        piece: The piece.
        cords: Indices of the cords of the plane that run in it.
        halves: How it is opened for them, or None.
    """

    piece: Any
    cords: tuple[int, ...]
    halves: Halves | None


class PieceOpener:
    """Open pieces along planes, each piece and plane once.

    Args:
        planes: The planes.
        cords: Indices of the cords in each plane.
        threads: The cords as thin tubes.
        margin: How far a limited cut continues beyond its cords, mm; None for cuts right through.
        play: Play of the lid of a limited cut, mm.
    """

    def __init__(
        self,
        planes: Sequence[Plane],
        cords: Sequence[Sequence[int]],
        threads: Sequence[Any],
        margin: float | None,
        play: float,
    ) -> None:
        self._planes, self._cords, self._threads = planes, cords, threads
        self._margin, self._play = margin, play
        self._opened: dict[tuple[int, int], OpenedPiece] = {}

    def open(self, piece: Any, k: int) -> OpenedPiece:
        """Open a piece along plane `k` into as few pieces as possible."""
        if (id(piece), k) not in self._opened:
            cords = tuple(c for c in self._cords[k] if runs_in(self._threads[c], piece))
            halves = None
            if cords:
                line = triangle_kernel.union([self._threads[c] for c in cords])
                halves = min(
                    _options(piece, self._planes[k], line, self._margin, self._play),
                    key=lambda h: (len(h.below) + len(h.above), h.rank),
                    default=None,
                )
            self._opened[id(piece), k] = OpenedPiece(piece, cords, halves)
        return self._opened[id(piece), k]


def _options(
    piece: Any, plane: Plane, line: Any, margin: float | None, play: float
) -> Iterator[Halves]:
    """Yield ways to open a piece along a plane for the cords of `line`: right through, or only what
    they touch on one side, if that can come out.
    """
    above, below = piece.split_by_plane(plane.normal, float(plane.normal @ plane.origin))
    if above.is_empty() or below.is_empty():
        return
    sides = (solids_of(below), solids_of(above))
    if not all(sides):
        return
    if margin is None:
        yield Halves(*sides, rank=0.0)
        if len(sides[0]) + len(sides[1]) == 2:
            return
    prisms = None if margin is None else _prisms_around(piece, plane, line, margin, play)
    is_found = False
    for s, side in enumerate((below, above)):
        prism, smaller = prisms[s] if prisms else (None, None)
        region = side if prism is None else side ^ triangle_kernel.solid_of(prism)
        candidates = solids_of(region)
        touched = [c for c in candidates if runs_in(line, c)]
        others = [c for c in candidates if not runs_in(line, c)]
        if not touched or _is_blocked(touched, others, plane):
            continue
        freed = triangle_kernel.union(touched)
        remaining = _remove(piece, plane, s, prism, freed, others)
        if remaining is None:
            continue
        rest = solids_of(remaining)
        lid = freed if smaller is None else freed ^ triangle_kernel.solid_of(smaller)
        taken = solids_of(lid)
        if not rest or not taken:
            continue
        is_found = True
        share = float(lid.volume() / piece.volume())
        yield Halves(
            *((taken, rest) if s == 0 else (rest, taken)),
            rank=1.0 + share,
            taken=tuple(taken),
            by=prisms[s] if prisms else None,
            gap=freed - lid if prisms else None,
        )
    if margin is not None and not is_found:
        yield Halves(*sides, rank=0.0)


def _remove(
    piece: Any, plane: Plane, s: int, prism: Prism | None, freed: Any, others: Sequence[Any]
) -> Any | None:
    """Return the rest of a piece when solids come off below (`s` = 0) or above (1) a plane.

    The rest is put together from the outside of the cut and from the other solids within it, since
    a difference of solids that share a curved skin leaves walls without thickness.

    Args:
        piece: The piece.
        plane: The plane of the cut.
        s: The side of the plane.
        prism: The limits of the cut, or None for the whole side.
        freed: The solids that come off.
        others: The other solids within the cut.

    Returns:
        The rest, or None if the other solids cannot be separated from those that come off.
    """
    if prism is None:
        normal = (1 - 2 * s) * plane.normal
        outside = piece.trim_by_plane(normal, float(normal @ plane.origin))
    else:
        outside = piece - triangle_kernel.solid_of(prism)
    if not others:
        return outside
    for overlap in OVERLAPS_MM:
        kept = [
            solid
            for solid in solids_of(_inside(piece, plane, s, prism, overlap))
            if any((solid ^ other).volume() > MIN_PIECE_MM3 for other in others)
        ]
        if all((solid ^ freed).volume() < MIN_PIECE_MM3 for solid in kept):
            return triangle_kernel.union([outside, *kept])
    # A shoulder of the body lies in the plane. The solids share only this plane and no skin.
    return triangle_kernel.union([outside, *others]) if prism is None else None


def _inside(piece: Any, plane: Plane, s: int, prism: Prism | None, growth: float) -> Any:
    """Cut a piece below (`s` = 0) or above (1) a plane, and return the solid within the cut.

    The cut is the half-space, or the prism that limits it; both are enlarged by `growth` mm.
    """
    normal = (2 * s - 1) * plane.normal
    side = piece.trim_by_plane(normal, float(normal @ plane.origin) - growth)
    if prism is None:
        return side
    polygon = m3.CrossSection([prism.polygon]).offset(growth, m3.JoinType.Miter, 2.0)
    grown = replace(
        prism,
        origin=prism.origin - growth * plane.normal,
        polygon=np.asarray(polygon.to_polygons()[0], float),
        height=prism.height + 2 * growth,
    )
    return side ^ triangle_kernel.solid_of(grown)


def _prisms_around(
    piece: Any, plane: Plane, line: Any, margin: float, play: float
) -> list[tuple[Prism, Prism]]:
    """Return the prisms below and above the plane that reach `margin` mm beyond the cords in it,
    each with the one `play` mm smaller.
    """
    corners = triangle_kernel.to_surface(piece ^ line).vertices
    flat = (corners - plane.origin) @ plane.axes[:, :2]
    grown = m3.CrossSection.hull_points(flat).offset(margin, m3.JoinType.Miter, 2.0).simplify(0.05)
    polygons = [
        np.asarray(c.to_polygons()[0], float)
        for c in (grown, grown.offset(-play / 2, m3.JoinType.Miter, 2.0))
    ]
    box = triangle_kernel.to_surface(piece).vertices @ plane.normal - plane.normal @ plane.origin
    low, high = 1.0 - float(box.min()), 1.0 + float(box.max())
    bottom = plane.origin - low * plane.normal
    below, above = (
        [Prism(origin, plane.axes, p, height) for p in polygons]
        for origin, height in ((bottom, low), (plane.origin, high))
    )
    return [(below[0], below[1]), (above[0], above[1])]


def _is_blocked(taken: Sequence[Any], others: Sequence[Any], plane: Plane) -> bool:
    """Return whether the other solids on the same side cover the removed ones along the normal."""
    if not others:
        return False
    a, b = (
        triangle_kernel.to_plane_frame(triangle_kernel.union(list(s)), plane.axes, np.zeros(3))
        for s in (taken, others)
    )
    return float((a.project() ^ b.project()).area()) > MAX_COVER_MM2
