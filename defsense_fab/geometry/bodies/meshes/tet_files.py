"""The boundary of tetrahedra in files of Gmsh, VTK and Medit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError

_FORMATS = {".msh": "gmsh", ".vtu": "vtu", ".mesh": "medit"}
#: Of the files that are read.
TET_SUFFIXES = tuple(_FORMATS)
_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def read_tets(path: Path, suffix: str) -> tuple[Float, Int]:
    """Vertices (n, 3), and as faces (m, 3) the tetrahedra's that only one of them has; the
    triangles where there are no tetrahedra. Raises BodyError for other cells, and whatever the
    reader does for damaged files."""
    import meshio

    mesh: Any = meshio.read(path, _FORMATS[suffix])
    points = np.asarray(mesh.points, float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise BodyError("its points are not in space", code="points-not-in-space")
    tets = _cells(mesh, "tetra", 4)
    if len(tets):
        _check(tets, len(points))
        return points, _boundary(points, tets)
    triangles = _cells(mesh, "triangle", 3)
    if not len(triangles):
        kinds = ", ".join(sorted({block.type for block in mesh.cells})) or "none"
        raise BodyError(
            f"it has neither tetrahedra nor triangles; its cells: {kinds}", code="no-triangles"
        )
    _check(triangles, len(points))
    return points, triangles


def _cells(mesh: Any, kind: str, corners: int) -> Int:
    """Of this kind, of any order."""
    own = [
        np.asarray(block.data, np.int64)[:, :corners]
        for block in mesh.cells
        if block.type.rstrip("0123456789") == kind
    ]
    return np.concatenate(own) if own else np.zeros((0, corners), np.int64)


def _check(cells: Int, count: int) -> None:
    if cells.min() < 0 or cells.max() >= count:
        raise BodyError("a cell names a point that is not there", code="vertex-missing")


def _boundary(points: Float, tets: Int) -> Int:
    x = points[tets]
    inward = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
    tets = np.where(inward[:, None], tets[:, [0, 2, 1, 3]], tets)
    faces = tets[:, _FACES].reshape(-1, 3)
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.asarray(faces[first[count == 1]])
