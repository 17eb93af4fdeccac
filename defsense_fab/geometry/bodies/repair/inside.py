"""What a surface encloses, by its winding number; the last word on whether it is sound."""

from __future__ import annotations

import igl
import numpy as np

from ....core.arrays import Bool, Float, Int

_STEP_OFF = 1e-5  # of the bounding box's diagonal
_HEIGHT = 1e-4  # likewise: thinner triangles may be steps no wider than what is stepped off


class Inside:
    """Of triangles that need be neither closed nor apart from each other: what the generalised
    winding number (Jacobson et al. 2013; Barill et al. 2018) says is in."""

    def __init__(self, vertices: Float, faces: Int) -> None:
        self._tree = igl.FastWindingNumberBVH()
        self._tree.init(np.ascontiguousarray(vertices), np.ascontiguousarray(faces))

    def number(self, points: Float) -> Float:
        """The winding number at points (n, 3)."""
        return np.asarray(self._tree.winding_number(np.ascontiguousarray(points)))

    def __call__(self, points: Float) -> Bool:
        """Whether points (n, 3) are in."""
        return np.asarray(self.number(points) > 0.5)


def beside(inside: Inside, points: Float, normals: Float, size: float) -> tuple[Float, Float]:
    """The winding numbers (n,) just behind and just before a surface with normals (n, 3) at its
    points (n, 3)."""
    step = _STEP_OFF * size * normals
    return inside.number(points - step), inside.number(points + step)


def wrong_faces(vertices: Float, faces: Int, size: float) -> Bool:
    """Triangles (m,) that do not have the inside behind them, with a winding number of 1, and the
    outside before them, with 0. Of those that are too thin to
    tell, none is wrong."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    longest = np.maximum.reduce([np.linalg.norm(x, axis=1) for x in (b - a, c - b, a - c)])
    whole = length > _HEIGHT * size * longest
    wrong = np.zeros(len(faces), bool)
    behind, before = beside(
        Inside(vertices, faces),
        ((a + b + c) / 3)[whole],
        normal[whole] / length[whole, None],
        size,
    )
    wrong[whole] = (np.abs(behind - 1) > 0.5) | (np.abs(before) > 0.5)
    return wrong
