"""Read files of tetrahedra or triangles: Gmsh (.msh), VTK (.vtu) and Medit (.mesh)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from .triangles import Triangles

_FORMATS = {".msh": "gmsh", ".vtu": "vtu", ".mesh": "medit"}
#: Suffixes of the files that are read.
TET_SUFFIXES = tuple(_FORMATS)
TET_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def read_tets(path: Path, suffix: str) -> Triangles:
    """Read the boundary of tetrahedra, or triangles if there are none.

    Returns:
        The faces that only one tetrahedron has, or the triangles.

    Raises:
        BodyError: For other cells. Damaged files raise whatever the reader does.
    """
    import meshio

    mesh: Any = meshio.read(path, _FORMATS[suffix])
    points = np.asarray(mesh.points, float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise BodyError("its points are not three-dimensional", code="points-not-in-space")
    tets = _cells_of(mesh, "tetra", 4)
    if len(tets):
        _check_cells(tets, len(points))
        return Triangles(points, _boundary(points, tets))
    triangles = _cells_of(mesh, "triangle", 3)
    if not len(triangles):
        kinds = ", ".join(sorted({block.type for block in mesh.cells})) or "none"
        raise BodyError(
            f"it has neither tetrahedra nor triangles; its cells: {kinds}", code="no-triangles"
        )
    _check_cells(triangles, len(points))
    return Triangles(points, triangles)


def _cells_of(mesh: Any, kind: str, corners: int) -> Int:
    """Return the cells of a kind, of any order."""
    blocks = [
        np.asarray(block.data, np.int64)[:, :corners]
        for block in mesh.cells
        if block.type.rstrip("0123456789") == kind
    ]
    return np.concatenate(blocks) if blocks else np.zeros((0, corners), np.int64)


def _check_cells(cells: Int, count: int) -> None:
    if cells.min() < 0 or cells.max() >= count:
        raise BodyError("a cell names a point that does not exist", code="vertex-missing")


def _boundary(points: Float, tets: Int) -> Int:
    x = points[tets]
    is_inverted = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
    tets = np.where(is_inverted[:, None], tets[:, [0, 2, 1, 3]], tets)
    faces = tets[:, TET_FACES].reshape(-1, 3)
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.asarray(faces[first[count == 1]])
