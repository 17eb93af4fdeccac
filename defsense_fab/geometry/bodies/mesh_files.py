"""Triangles from files of meshes, in mm where the format says what its lengths are."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import BodyError

# The boundary of tetrahedra in files of Gmsh, VTK and Medit.

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


# What kind of body a file holds, by its content: names lie.

_STEP = re.compile(rb"\s*(/\*.*?\*/\s*)*ISO-10303-21\s*;", re.DOTALL)
_VERTEX = re.compile(rb"^\s*v\s+[-+.\d]", re.MULTILINE)
_FACE = re.compile(rb"^\s*f\s+[-\d]", re.MULTILINE)
_OFF = re.compile(rb"\s*(#[^\n]*\n\s*)*(ST)?C?N?OFF\b")
_MEDIT = re.compile(rb"\s*(#[^\n]*\n\s*)*MeshVersionFormatted\b")
_VTU = re.compile(
    rb"\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)*<VTKFile\b[^>]*UnstructuredGrid", re.DOTALL
)
_GLTF = re.compile(rb'\s*\{.*"asset"\s*:', re.DOTALL)
_HEAD, _TRIANGLE = 84, 50  # bytes of a binary STL file
_BEGINNING = 4096


def kind_of_file(content: bytes) -> str | None:
    """The suffix of the file that these bytes are: .step, .stl, .obj, .ply, .off, .3mf, .glb,
    .gltf, .msh, .vtu, .mesh; None for what is none of them. That it can be read is not said."""
    start = content[:_BEGINNING]
    for suffix, pattern in (
        (".step", _STEP), (".off", _OFF), (".mesh", _MEDIT), (".vtu", _VTU)
    ):  # fmt: skip
        if pattern.match(start):
            return suffix
    if re.match(rb"ply\s", start):
        return ".ply"
    if start.startswith(b"glTF"):
        return ".glb"
    if start.startswith(b"$MeshFormat"):
        return ".msh"
    if start.startswith(b"PK\x03\x04") and b"3D/" in content:
        return ".3mf"
    if len(content) >= _HEAD:
        count = int.from_bytes(content[_HEAD - 4 : _HEAD], "little")
        if count and len(content) == _HEAD + _TRIANGLE * count:
            return ".stl"
    if start.lstrip().startswith(b"solid") and b"facet" in content:
        return ".stl"
    if b"\0" in start:
        return None
    if start.lstrip().startswith(b"{") and _GLTF.match(content) and b'"meshes"' in content:
        return ".gltf"
    if _VERTEX.search(content) and _FACE.search(content):
        return ".obj"
    return None


#: Of the files that are read.
SUFFIXES = (".stl", ".obj", ".ply", ".off", ".3mf", ".glb", ".gltf", *TET_SUFFIXES)
#: Of those whose lengths have a unit.
IN_MM = (".3mf", ".glb", ".gltf")
#: As they are told.
KINDS = "STL, OBJ, PLY, OFF, 3MF, GLB, or tetrahedra in .msh, .vtu or .mesh"
_3MF_UNITS = {
    "MicroMeter": 1e-3,
    "MilliMeter": 1.0,
    "CentiMeter": 10.0,
    "Inch": 25.4,
    "Foot": 304.8,
    "Meter": 1e3,
}


@dataclass(frozen=True)
class Triangles:
    """`vertices` (n, 3), in mm where the format has a unit, `faces` (m, 3), what of the reading is
    to be `told`, and the mm of the file's unit, 1 where it has none."""

    vertices: Float
    faces: Int
    told: tuple[str, ...] = ()
    unit: float = 1.0


def read_triangles(path: Path, suffix: str) -> Triangles:
    """The triangles of a file of the kind that has this suffix. Raises BodyError where it cannot be
    read. Other files that it names are not."""
    if suffix not in SUFFIXES:
        raise BodyError(
            f"{path}: unknown kind of mesh; give {KINDS}", code="unknown-format", suffix=suffix
        )
    told: tuple[str, ...] = ()
    unit = 1.0
    try:
        if suffix == ".3mf":
            vertices, faces, unit = _read_3mf(path)
        elif suffix in TET_SUFFIXES:
            vertices, faces = read_tets(path, suffix)
        elif suffix in (".glb", ".gltf"):
            vertices, faces = _read_gltf(path, suffix)
            unit = 1e3
            told = ("took metres with y upwards, as GLB has them, to millimetres with z upwards",)
        else:
            vertices, faces = _read_surface(path, suffix)
    except MemoryError:
        raise BodyError(
            f"{path}: is too large to be read, or claims to be; write the file again from the"
            " program that made it",
            code="file-too-large",
        ) from None
    except SystemExit:  # meshio's end the program where a file is damaged
        raise BodyError(
            f"{path}: cannot be read as {suffix[1:].upper()}: it is damaged; write the file again"
            " from the program that made it",
            code="file-invalid",
            suffix=suffix,
        ) from None
    except Exception as error:  # readers raise whatever their parsers do
        text = " ".join(str(error).split())[:300] or type(error).__name__
        code = error.code if isinstance(error, BodyError) else "file-invalid"
        raise BodyError(
            f"{path}: cannot be read as {suffix[1:].upper()}: {text}", code=code, suffix=suffix
        ) from None
    if len(faces) == 0:
        raise BodyError(f"{path}: holds no triangles", code="no-triangles")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise BodyError(
            f"{path}: a triangle names a vertex that is not there", code="vertex-missing"
        )
    if not np.isfinite(vertices).all():
        raise BodyError(f"{path}: a vertex is not a finite number", code="vertex-not-finite")
    return Triangles(vertices, faces, told, unit)


def _read_surface(path: Path, suffix: str) -> tuple[Float, Int]:
    import trimesh

    with path.open("rb") as file:  # by content: the name may have another suffix
        # Materials are files that the mesh names: they are not read.
        mesh: Any = trimesh.load_mesh(
            file, file_type=suffix[1:], process=False, skip_materials=True
        )
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


class _NoFiles:
    """In place of the files that a glTF file names."""

    def get(self, name: str) -> bytes:
        raise BodyError(
            f"it names another file, {name[:80]!r}, which is not read; export GLB, which holds all",
            code="names-another-file",
            name=name,
        )

    __getitem__ = get


def _read_gltf(path: Path, suffix: str) -> tuple[Float, Int]:
    import trimesh

    content = path.read_bytes()
    nowhere: Any = _NoFiles()
    scene: Any = trimesh.load_scene(
        io.BytesIO(content), file_type=suffix[1:], skip_materials=True, resolver=nowhere
    )
    mesh = scene.to_mesh()
    x, y, z = np.asarray(mesh.vertices, float).T
    return 1e3 * np.stack([x, -z, y], axis=1), np.asarray(mesh.faces, np.int64)


def _read_3mf(path: Path) -> tuple[Float, Int, float]:
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    unit = _3MF_UNITS[model.GetUnit().name]
    merged = model.MergeToModel()  # build items with their components and transforms
    objects = merged.GetMeshObjects()
    vertices, faces, offset = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    while objects.MoveNext():
        mesh = objects.GetCurrentMeshObject()
        v = np.array([list(p.Coordinates) for p in mesh.GetVertices()], float).reshape(-1, 3)
        f = np.array([list(t.Indices) for t in mesh.GetTriangleIndices()], np.int64).reshape(-1, 3)
        vertices.append(v)
        faces.append(f + offset)
        offset += len(v)
    return unit * np.concatenate(vertices), np.concatenate(faces), unit
