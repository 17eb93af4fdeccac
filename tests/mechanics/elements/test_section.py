"""Compare plane cuts of a mesh with known areas."""

import numpy as np
import pytest

from defsense_fab.core.mesh import TetMesh
from defsense_fab.mechanics.elements.section import cut
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh

_SIZE = np.array([4.0, 3.0, 2.0])
# Six tets around a cube's diagonal, in every cell of a grid.
_ORDERS = [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]


@pytest.fixture(scope="module")
def box():
    """Return a box of 4 x 3 x 2 mm with nodes at whole mm."""
    shape = tuple(_SIZE.astype(int) + 1)
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3)
    tets = []
    for low in np.ndindex(*(n - 1 for n in shape)):
        for order in _ORDERS:
            corners = [np.array(low)]
            for axis in order:
                corners.append(corners[-1] + np.eye(3, dtype=int)[axis])
            tet = [int(np.ravel_multi_index(c, shape)) for c in corners]
            x = nodes[tet]
            tets.append(tet if np.linalg.det(x[1:] - x[0]) > 0 else [tet[k] for k in (1, 0, 2, 3)])
    return QuadraticMesh.from_linear(TetMesh(nodes.astype(float), np.array(tets)))


@pytest.mark.parametrize(
    ("origin", "normal", "area"),
    [
        ([1.3, 0, 0], [2, 0, 0], 6.0),
        ([0, 1.0, 0], [0, 1, 0], 8.0),  # through nodes and along faces
        ([0, 0, 2.0], [0, 0, 1], 12.0),  # along a side of the box
        ([0, 0, 0.7], [0, 0, 1], 12.0),
        ([2, 1.5, 1], [3, -4, 0], 10.0),  # the diagonal of 4 x 3, times 2
        ([0.5, 0, 0], [1, 1, 0], 2 * np.sqrt(0.5)),
    ],
)
def test_the_area_of_a_cut_is_exact(box, origin, normal, area):
    found = cut(box, np.array(origin, float), np.array(normal, float))
    assert found.area == pytest.approx(area, abs=1e-9)
    finer = found.subdivide(0.21)
    assert finer.area == pytest.approx(area, abs=1e-9)
    corners = finer.points[finer.triangles]
    assert np.linalg.norm(corners - np.roll(corners, 1, 1), axis=2).max() <= 0.21 + 1e-9
    for part in (found, finer):
        n = np.array(normal) / np.linalg.norm(normal)
        np.testing.assert_allclose((part.points - origin) @ n, 0, atol=1e-9)
        corner = box.nodes[box.cells[part.at.cell, :4]]
        np.testing.assert_allclose(np.einsum("vb,vbj->vj", part.at.bary, corner), part.points)
        assert part.at.depth.min() > -1e-9
        assert (part.at.cell[part.triangles] == part.at.cell[part.triangles[:, :1]]).all()


def test_a_plane_outside_the_body_gives_an_empty_section(box):
    found = cut(box, np.array([9.0, 0, 0]), np.array([1.0, 0, 0]))
    assert (found.area, len(found.triangles), len(found.subdivide(1.0).points)) == (0.0, 0, 0)
