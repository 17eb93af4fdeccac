"""Tetrahedra in boxes on a regular grid: the same on every run, with nodes on every grid plane."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from defsense_fab.core.mesh import TetMesh


def grid_of_tets(axes: Sequence[np.ndarray]) -> TetMesh:
    """Return Kuhn's six tets in each cell of the grid with coordinates (mm) along x, y and z."""
    x, y, z = (len(a) for a in axes)
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    step = np.array([y * z, z, 1])
    cells = np.stack(np.meshgrid(*map(np.arange, (x - 1, y - 1, z - 1)), indexing="ij"), axis=-1)
    first = cells.reshape(-1, 3) @ step
    tets = []
    for order in permutations(range(3)):
        walk = np.cumsum([0, *step[list(order)]])
        odd = np.linalg.det(np.eye(3)[list(order)]) < 0
        tets.append(first[:, None] + walk[[0, 2, 1, 3] if odd else [0, 1, 2, 3]])
    return TetMesh(nodes, np.concatenate(tets))
