"""Compare the depth on a grid with the exact depth."""

import numpy as np
import pytest

from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.kernels.surface_queries import SignedDistance
from defsense_fab.optimization.problem.depth_grid import DepthGrid
from tests.conftest import box_surface


def two_boxes(gap):
    """Return two boxes next to each other, one of them hollow."""
    parts = [
        box_surface([-20, -20, -20], [20, 20, 20]),
        box_surface([20 + gap, -20, -20], [60, 20, 20]),
        box_surface([-10, -10, -10], [10, 10, 10]),
    ]
    vertices, faces, first = [], [], 0
    for k, part in enumerate(parts):
        vertices.append(part.vertices)
        faces.append((part.faces if k < 2 else part.faces[:, ::-1]) + first)
        first += len(part.vertices)
    return Surface(np.concatenate(vertices), np.concatenate(faces))


@pytest.mark.parametrize("gap", [0.7, 6.0])  # less than the grid's step, and more
def test_the_grid_has_the_exact_depth_at_its_nodes(gap):
    surface = two_boxes(gap)
    grid = DepthGrid(surface)
    shape = grid.depths.shape
    nodes = grid.origin + grid.spacing * np.stack(np.indices(shape), axis=-1)
    exact_depth, flat = SignedDistance(surface), nodes.reshape(-1, 3)
    exact = np.where(exact_depth.inside(flat), 1, -1) * exact_depth.unsigned(flat)
    exact = exact.reshape(shape)
    np.testing.assert_array_equal(grid.depths, exact)
    assert (exact > 0).any()
    assert grid(np.array([[0.0, 0, 0], [15, 0, 0]])) == pytest.approx(
        [-10, 5], abs=grid.spacing / 2
    )
