"""Quadratic tets cut by a plane."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyvista as pv

from ....core.arrays import Float, Int

#: Eight linear tets in a quadratic one, by the numbers that VTK gives its nodes.
_EIGHT = np.array([[0, 4, 6, 7], [1, 5, 4, 8], [2, 6, 5, 9], [3, 7, 9, 8],
                   [4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5]])  # fmt: skip


def mesh_cut(
    nodes: Float, cells: Int, origin: Float, normal: Float, data: Mapping[str, Float]
) -> Any:
    """The plane's section through nodes (n, 3) mm and quadratic `cells` (m, 10), as a pyvista mesh
    with the node `data` on it. Only cells that the plane meets are looked at."""
    side = (nodes - origin) @ normal
    of = side[cells]
    met = cells[(of.min(1) <= 0) & (of.max(1) >= 0)]
    tets = met[:, _EIGHT].reshape(-1, 4)
    of = side[tets]
    tets = tets[(of.min(1) <= 0) & (of.max(1) >= 0)]
    used, small = np.unique(tets, return_inverse=True)
    if not len(used):
        return pv.PolyData()
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: small.reshape(-1, 4)}, nodes[used])
    for name, values in data.items():
        grid.point_data[name] = values[used]
    return grid.slice(normal=tuple(normal), origin=tuple(origin))
