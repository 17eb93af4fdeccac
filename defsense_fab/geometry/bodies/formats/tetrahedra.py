"""Read files of cells: Gmsh (.msh), VTK (.vtu) and Medit (.mesh)."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from .medit import read_medit
from .polygons import divide_rows
from .text import decode_text
from .triangles import Triangles

#: Suffixes of the files that are read.
TET_SUFFIXES = (".msh", ".vtu", ".mesh")
TET_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
_PYRAMID_SIDES = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
_WEDGE_SIDES = [[0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]]
_HEXAHEDRON_SIDES = [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
#: Corners of each kind of solid cell, and its faces, outward.
_SOLID_CELLS = {
    "tetra": (4, TET_FACES.tolist()),
    "pyramid": (5, [[0, 3, 2, 1], *_PYRAMID_SIDES]),
    "wedge": (6, [[0, 2, 1], [3, 4, 5], *_WEDGE_SIDES]),
    "hexahedron": (8, [[0, 3, 2, 1], [4, 5, 6, 7], *_HEXAHEDRON_SIDES]),
}
_FLAT_CELLS = {"triangle": 3, "quad": 4}
#: Cells that have no part in a surface.
_SMALLER_CELLS = ("vertex", "line")
#: Results and names that the body does not need, and which other readers refuse for their faults.
_MSH_RESULTS = re.compile(
    rb"^\$(NodeData|ElementData|ElementNodeData|InterpolationScheme|PhysicalNames|Periodic)\b"
    rb".*?^\$End\1[^\n]*\n?",
    re.DOTALL | re.MULTILINE,
)
_VTU_RESULTS = re.compile(rb"<(PointData|CellData|FieldData)\b(?:[^>]*/>|.*?</\1\s*>)", re.DOTALL)


def read_cells(path: Path, suffix: str) -> Triangles:
    """Read the boundary of solid cells, or the triangles and quadrangles if there are none.

    Returns:
        The faces that only one cell has, or all faces, as triangles.

    Raises:
        BodyError: For other cells. Damaged files raise whatever the reader does.
    """
    content = path.read_bytes()
    if suffix == ".mesh":
        points, cells = read_medit(content)
    else:
        points, cells = _read_with_meshio(content, suffix)
    if points.ndim != 2 or points.shape[1] != 3:
        raise BodyError(
            "its points are not three-dimensional",
            code="points-not-in-space",
            action="Export the mesh with three coordinates",
        )
    solid = _select(cells, {kind: count for kind, (count, _) in _SOLID_CELLS.items()})
    flat = _select(cells, _FLAT_CELLS)
    others = {kind for kind, _ in cells} - {*_SOLID_CELLS, *_FLAT_CELLS, *_SMALLER_CELLS}
    if others or not (solid or flat):
        kinds = ", ".join(sorted(others or {kind for kind, _ in cells})) or "none"
        raise BodyError(
            f"it has cells that are not read: {kinds}"
            if others
            else f"it has neither solid cells nor faces; its cells: {kinds}",
            code="cells-unsupported" if others else "no-triangles",
            action="Export tetrahedra or triangles",
            kinds=kinds,
        )
    for corners in (solid or flat).values():
        if corners.min() < 0 or corners.max() >= len(points):
            raise BodyError("a cell names a point that does not exist", code="vertex-missing")
    if not solid:
        return Triangles(points, divide_rows(points, list(flat.values())))
    if set(solid) == {"tetra"}:
        return Triangles(points, _tet_boundary(points, solid["tetra"]))
    return Triangles(points, divide_rows(points, _boundary(solid)))


def _select(cells: list[tuple[str, Int]], counts: dict[str, int]) -> dict[str, Int]:
    """Return the corners of all cells of each kind that has some."""
    selected = {}
    for kind, count in counts.items():
        blocks = [corners[:, :count] for name, corners in cells if name == kind and len(corners)]
        if blocks:
            selected[kind] = np.concatenate(blocks)
    return selected


def _read_with_meshio(content: bytes, suffix: str) -> tuple[Float, list[tuple[str, Int]]]:
    """Return points and cells; of a cell of higher order, its name without the order."""
    import meshio

    with tempfile.TemporaryDirectory(prefix="defsense-") as folder:
        path = Path(folder) / f"mesh{suffix}"
        path.write_bytes(_without_results(content, suffix))
        # meshio.read prints problems and ends the program.
        module = meshio.vtu if suffix == ".vtu" else meshio.gmsh
        mesh: Any = module.read(path)
    cells = []
    for block in mesh.cells:
        kind = str(block.type).rstrip("0123456789")
        ragged = kind in ("polyhedron", "polygon")  # not read, and named by the caller
        corners = np.zeros((0, 0), np.int64) if ragged else np.asarray(block.data, np.int64)
        cells.append((kind, corners))
    return np.asarray(mesh.points, float), cells


def _without_results(content: bytes, suffix: str) -> bytes:
    if suffix == ".vtu":
        head, mark, data = content.partition(b"<AppendedData")
        return _VTU_RESULTS.sub(b"", head) + mark + data
    if b"\0" not in content:
        content = decode_text(content)
    return _MSH_RESULTS.sub(b"", content)


def _boundary(cells: dict[str, Int]) -> list[Int]:
    """Return the faces (m, 3) and (m, 4) that only one solid cell has."""
    boundary = []
    for count in (3, 4):
        faces = [
            corners[:, face]
            for kind, corners in cells.items()
            for face in _SOLID_CELLS[kind][1]
            if len(face) == count
        ]
        if faces:
            boundary.append(_single(np.concatenate(faces)))
    return boundary


def _tet_boundary(points: Float, tets: Int) -> Int:
    x = points[tets]
    is_inverted = np.linalg.det(x[:, 1:] - x[:, :1]) < 0
    tets = np.where(is_inverted[:, None], tets[:, [0, 2, 1, 3]], tets)
    return _single(tets[:, TET_FACES].reshape(-1, 3))


def _single(faces: Int) -> Int:
    """Return the faces whose corners no other face has."""
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.asarray(faces[first[count == 1]])
