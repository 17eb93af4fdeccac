"""Triangles from files of meshes, in mm where the format says what its lengths are."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from .tet_files import TET_SUFFIXES, read_tets

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
