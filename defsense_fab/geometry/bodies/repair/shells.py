"""Sort the closed shells of a surface into bodies, cavities and debris."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from ....core.mesh import Surface
from ...kernels.surface_queries import SignedDistance
from .findings import (
    closed_cavity_error,
    describe_cavity,
    describe_point,
    describe_solids,
    format_count,
)

#: Pieces and cavities below this share of the volume are debris.
DEBRIS_SHARE = 1e-3
MAX_NESTED = 200  # shells (the largest) whose holders are searched for
MIN_VOLUME_SHARE = 1e-9  # of the cube of the size: smaller shells enclose nothing


@dataclass(frozen=True)
class Shell:
    """A closed part of a surface.

    Attributes:
        faces: Triangles (m, 3) of the common vertices, turned outward.
        volume: Enclosed volume, mm^3.
        turned: Whether the triangles were turned inward before.
        low: Lowest corner (3,) of the bounding box, mm.
        high: Highest corner (3,), mm.
    """

    faces: Int
    volume: float
    turned: bool
    low: Float
    high: Float

    @property
    def middle(self) -> Float:
        """Center (3,) of the bounding box, mm."""
        return (self.low + self.high) / 2


def find_shells(surface: Surface, size: float) -> list[Shell]:
    """Return the shells that enclose a volume, the largest first."""
    faces = surface.faces
    label = np.asarray(igl.facet_components(np.ascontiguousarray(faces))[1])
    order = np.argsort(label, kind="stable")
    shells = []
    for members in np.split(order, np.nonzero(np.diff(label[order]))[0] + 1):
        triangles = faces[np.sort(members)]
        corners = surface.vertices[triangles]
        a, b, c = (corners[:, i] - corners[0, 0] for i in range(3))
        volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
        if abs(volume) < MIN_VOLUME_SHARE * size**3 and len(members) < len(faces):
            continue
        turned = volume < 0
        shells.append(
            Shell(
                np.ascontiguousarray(triangles[:, ::-1]) if turned else triangles,
                abs(volume),
                turned,
                corners.min((0, 1)),
                corners.max((0, 1)),
            )
        )
    return sorted(shells, key=lambda s: -s.volume)


def find_holders(
    vertices: Float, shells: list[Shell], crossing: set[tuple[int, int]]
) -> list[int | None]:
    """Return, for each shell, the index of the smallest shell that holds it, or None.

    Args:
        vertices: Corners (n, 3), mm.
        shells: Shells, the largest first.
        crossing: Pairs of shells that cross, the first before the second: they do not hold each
            other.
    """
    trees: dict[int, SignedDistance] = {}
    holder: list[int | None] = [None] * len(shells)
    for i, inner in enumerate(shells[:MAX_NESTED]):
        for j in range(i - 1, -1, -1):
            outer = shells[j]
            if (
                (j, i) in crossing
                or (outer.low > inner.low).any()
                or (outer.high < inner.high).any()
            ):
                continue
            if j not in trees:
                trees[j] = SignedDistance(Surface(vertices, outer.faces))
            if trees[j].inside(vertices[inner.faces[:3, 0]]).all():
                holder[i] = j
                break
    return holder


def remove_inner_shells(
    shells: list[Shell], holder: list[int | None], where: str, fill: bool
) -> tuple[list[Shell], list[str]]:
    """Return the shells that no other holds: everything inside them is solid.

    Args:
        shells: Shells, the largest first.
        holder: Result of `find_holders`.
        where: File to name in errors.
        fill: Whether cavities are filled; otherwise large ones are an error.

    Returns:
        The outer shells, and sentences on what was done.

    Raises:
        BodyError: If there are cavities that may not be filled.
    """
    outer = [s for s, h in zip(shells, holder, strict=True) if h is None]
    whole = sum(s.volume for s in outer)
    cavities, buried = [], 0
    for s, h in zip(shells, holder, strict=True):
        if h is None:
            continue
        if holder[h] is None and s.turned != shells[h].turned:
            cavities.append(s)
        else:
            buried += 1
    sentences: list[str] = []
    if cavities:
        first, smaller = cavities[0], len(cavities) - 1
        large = [c for c in cavities if c.volume >= DEBRIS_SHARE * whole]
        if large and not fill:
            raise closed_cavity_error(where, first.volume, first.middle, smaller)
        sentences.append(f"filled {describe_cavity(first.volume, first.middle, smaller)}")
    if buried:
        sentences.append(f"removed {format_count(buried, 'shell')} inside of the solid")
    return outer, sentences


def select_piece(pieces: list[Shell], where: str) -> tuple[list[Shell], list[str]]:
    """Return the one piece that is not debris, in a list, and sentences on what was done.

    Raises:
        BodyError: If there are several pieces.
    """
    whole = sum(p.volume for p in pieces)
    large = [p for p in pieces if p.volume >= DEBRIS_SHARE * whole]
    debris = [p for p in pieces if p.volume < DEBRIS_SHARE * whole]
    if len(large) > 1:
        descriptions = describe_solids([(p.volume, p.middle) for p in large])
        raise BodyError(
            f"consists of {len(large)} separate pieces: {descriptions}",
            code="separate-pieces",
            where=where,
            action="Unite the pieces or keep one",
            count=len(large),
            volumes=[p.volume for p in large],
            places=[p.middle.tolist() for p in large],
        )
    if not debris:
        return large, []
    volume = sum(p.volume for p in debris)
    return large, [
        f"dropped {format_count(len(debris), 'small piece')} apart from the body, {volume:.2g} mm3"
        f" together, the largest near {describe_point(debris[0].middle)}"
    ]
