"""Replace facets whose three corners are on a line, without moving a corner.

The long side of such a facet is replaced by the other diagonal of the two facets that meet there.
The surface stays the same, and every edge keeps exactly two facets.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int
from ...core.mesh import Surface

#: Facets that are not higher over their longest side are lines for programs (trimesh, `tol.merge`).
MAX_LINE_HEIGHT_MM = 1e-8
MAX_PASSES = 50  # over the lines of a surface


def count_lines(surface: Surface) -> int:
    """Return the number of facets whose three corners are on a line."""
    return int((_heights(surface.vertices[surface.faces]) <= MAX_LINE_HEIGHT_MM).sum())


def replace_lines(surface: Surface) -> Int:
    """Return the faces (m, 3) of a surface, with as few lines among them as possible.

    Lines stay where another diagonal exists already or would be outside of the surface, and in
    surfaces that are not closed.

    Args:
        surface: Surface with the coordinates that programs read, mm.
    """
    lines = np.flatnonzero(_heights(surface.vertices[surface.faces]) <= MAX_LINE_HEIGHT_MM)
    if not len(lines):
        return surface.faces
    facets = _Facets(surface)
    if not facets.are_closed:
        return surface.faces
    remaining = lines.tolist()
    for _ in range(MAX_PASSES):
        tried = [(facet, facets.replace(facet)) for facet in remaining]
        remaining = [facet for facet in remaining if facets.is_line(facet)]
        remaining += [facet for _, facet in tried if facet is not None and facets.is_line(facet)]
        remaining = sorted(set(remaining))
        if not remaining or all(other is None for _, other in tried):
            break
    return facets.faces


class _Facets:
    """Facets and the two that meet at each edge, by the places of their corners.

    Attributes:
        faces: Indices of corners (m, 3).
        are_closed: Whether each side of a facet is the side of exactly one other, reversed.
    """

    def __init__(self, surface: Surface) -> None:
        self.faces = surface.faces.copy()
        self._vertices = surface.vertices
        places = np.unique(surface.vertices + 0.0, axis=0, return_inverse=True)[1].reshape(-1)
        self._place = places.tolist()  # of each corner
        faces = places[self.faces]
        starts, ends = faces.ravel().tolist(), np.roll(faces, -1, axis=1).ravel().tolist()
        sides = zip(starts, ends, strict=True)
        self._facet_of_side = {side: k // 3 for k, side in enumerate(sides)}
        self.are_closed = len(self._facet_of_side) == faces.size and all(
            (end, start) in self._facet_of_side for start, end in self._facet_of_side
        )

    def is_line(self, facet: int) -> bool:
        """Return whether the corners of a facet are on a line."""
        return self._height(self.faces[facet].tolist()) <= MAX_LINE_HEIGHT_MM

    def replace(self, facet: int) -> int | None:
        """Replace the longest side of a line by the other diagonal, if possible.

        Returns:
            The other facet that changed; None if none did.
        """
        if not self.is_line(facet):
            return None
        a, b, apex = self._from_longest_side(facet)
        other = self._facet_of_side[self._place[b], self._place[a]]
        top = self._corner_after(other, a)
        new = ((apex, a, top), (top, b, apex))
        if not self._is_better(other, top, apex, new):
            return None
        for f in (facet, other):
            self._forget(f)
        for f, corners in zip((facet, other), new, strict=True):
            self.faces[f] = corners
            self._remember(f)
        return other

    def _is_better(
        self, other: int, top: int, apex: int, new: tuple[tuple[int, int, int], ...]
    ) -> bool:
        """Return whether two facets may take the place of a line and the `other` facet."""
        diagonal = self._place[apex], self._place[top]
        is_free = not {diagonal, diagonal[::-1]} & self._facet_of_side.keys()
        if diagonal[0] == diagonal[1] or not is_free:
            return False
        if self.is_line(other):  # both may be replaced at their other sides, if these are shorter
            a, b, _ = self._from_longest_side(other)
            longest = np.linalg.norm(self._vertices[b] - self._vertices[a])
            corners = self._vertices[np.array(new)]
            return bool(_lengths(corners).max() < longest)
        normal = self._normal(self.faces[other].tolist())
        return all(
            self._height(f) > MAX_LINE_HEIGHT_MM and self._normal(f) @ normal > 0 for f in new
        )

    def _from_longest_side(self, facet: int) -> tuple[int, int, int]:
        """Return the corners of a facet, starting with the ends of its longest side."""
        corners = self.faces[facet]
        start = int(_lengths(self._vertices[corners][None])[0].argmax())
        a, b, c = np.roll(corners, -start).tolist()
        return a, b, c

    def _corner_after(self, facet: int, corner: int) -> int:
        """Return the corner of a facet that follows the place of a corner."""
        corners = self.faces[facet].tolist()
        place = self._place[corner]
        return int(next(corners[k - 2] for k in range(3) if self._place[corners[k]] == place))

    def _sides(self, facet: int) -> list[tuple[int, int]]:
        a, b, c = (self._place[k] for k in self.faces[facet].tolist())
        return [(a, b), (b, c), (c, a)]

    def _forget(self, facet: int) -> None:
        for side in self._sides(facet):
            self._facet_of_side.pop(side, None)

    def _remember(self, facet: int) -> None:
        for side in self._sides(facet):
            self._facet_of_side[side] = facet

    def _height(self, corners: tuple[int, ...] | list[int]) -> float:
        return float(_heights(self._vertices[list(corners)][None])[0])

    def _normal(self, corners: tuple[int, ...] | list[int]) -> Float:
        a, b, c = self._vertices[list(corners)]
        return np.asarray(np.cross(b - a, c - a))


def _lengths(corners: Float) -> Float:
    """Return the lengths (m, 3) of the sides of triangles (m, 3, 3), the first from corner 0."""
    return np.asarray(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2))


def _heights(corners: Float) -> Float:
    """Return the heights (m,) of triangles (m, 3, 3) over their longest sides."""
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    longest = _lengths(corners).max(axis=1)
    return np.asarray(np.linalg.norm(doubled, axis=1) / np.where(longest > 0, longest, 1))
