"""Cut a mesh by a plane into triangles, each of which lies in one tet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ...core.arrays import Float, Int
from .point_location import LocatedPoints
from .tet10 import QuadraticMesh

#: Nodes nearer to the plane than this share of the mesh's size count as above it, so that a plane
#: through nodes and faces cuts each tet once.
_TOUCH_RTOL = 1e-9


@dataclass(frozen=True)
class Section:
    """A plane cut of a mesh.

    No vertex is shared by two tets, because gradients differ on either side of a face.

    Attributes:
        at: Tets and weights of the vertices.
        points: (v, 3) mm, the vertices at rest.
        triangles: (t, 3) vertex numbers.
    """

    at: LocatedPoints
    points: Float
    triangles: Int

    @property
    def area(self) -> float:
        """Area at rest, mm^2."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    def subdivide(self, edge: float) -> Section:
        """Return the same cut in triangles whose edges are at most `edge` mm long at rest."""
        corners = self.points[self.triangles]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        times = np.maximum(np.ceil(longest / edge - 1e-9), 1).astype(int)
        cells, barys, points, triangles, count = [], [], [], [], 0
        for k in np.unique(times).tolist():
            rows = self.triangles[times == k]
            weights, pattern = _divided(k)
            cells.append(np.repeat(self.at.cell[rows[:, 0]], len(weights)))
            barys.append((weights @ self.at.bary[rows]).reshape(-1, 4))
            points.append((weights @ self.points[rows]).reshape(-1, 3))
            first = count + len(weights) * np.arange(len(rows))
            triangles.append((first[:, None, None] + pattern).reshape(-1, 3))
            count += len(weights) * len(rows)
        if not count:
            return self
        at = LocatedPoints(np.concatenate(cells), np.concatenate(barys))
        return Section(at, np.concatenate(points), np.concatenate(triangles))


def cut(mesh: QuadraticMesh, origin: Float, normal: Float) -> Section:
    """Cut a mesh at rest by a plane.

    Args:
        mesh: The mesh.
        origin: A point (3,) mm of the plane.
        normal: Normal (3,) of the plane, of any length.

    Returns:
        The section, without triangles if the plane misses the mesh.
    """
    tets, normal = mesh.cells[:, :4], normal / np.linalg.norm(normal)
    distance = ((mesh.nodes - origin) @ normal)[tets]
    distance[np.abs(distance) < _TOUCH_RTOL * max(float(np.ptp(mesh.nodes)), 1.0)] = 0.0
    below = distance < 0
    count = below.sum(axis=1)
    edges, cells = [], []  # the two corners between which each vertex lies, and its tet
    for n in (1, 3):
        cell = np.flatnonzero(count == n)
        alone = (below[cell] == (n == 1)).argmax(axis=1)
        others = (alone[:, None] + [1, 2, 3]) % 4
        edges.append(np.stack([np.repeat(alone, 3), others.ravel()], axis=1))
        cells.append(np.repeat(cell, 3))
    cell = np.flatnonzero(count == 2)
    order = np.argsort(below[cell], axis=1, kind="stable")  # two above, two below
    edges.append(order[:, [[0, 2], [0, 3], [1, 3], [1, 2]]].reshape(-1, 2))
    cells.append(np.repeat(cell, 4))
    threes = sum(map(len, cells[:2]))
    triangles = np.concatenate(
        [
            np.arange(threes).reshape(-1, 3),
            (threes + 4 * np.arange(len(cell))[:, None, None] + [[0, 1, 2], [0, 2, 3]]).reshape(
                -1, 3
            ),
        ]
    )
    where, pair = np.concatenate(cells), np.concatenate(edges)
    d = np.take_along_axis(distance[where], pair, axis=1)
    share = d[:, 0] / (d[:, 0] - d[:, 1])
    bary = np.zeros((len(where), 4))
    rows = np.arange(len(where))
    bary[rows, pair[:, 0]], bary[rows, pair[:, 1]] = 1 - share, share
    points = np.einsum("vb,vbj->vj", bary, mesh.nodes[tets[where]])
    return Section(LocatedPoints(where, bary), points, triangles)


@cache
def _divided(times: int) -> tuple[Float, Int]:
    """Divide each side of a triangle; return corner weights (v, 3) and triangles (t, 3)."""
    places = [(i, j) for i in range(times + 1) for j in range(times + 1 - i)]
    number = {place: n for n, place in enumerate(places)}
    triangles = []
    for i, j in places:
        if i + j < times:
            triangles.append([number[i, j], number[i + 1, j], number[i, j + 1]])
        if i + j < times - 1:
            triangles.append([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]])
    weights = np.array([[times - i - j, i, j] for i, j in places], float) / times
    return weights, np.array(triangles)
