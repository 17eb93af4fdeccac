"""Read 3MF files: the body among the supports, modifiers and other objects of a print."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ....core.arrays import Float, Int
from ....core.errors import BodyError
from ....core.mesh import Surface
from .threemf_package import (
    CURA_KINDS,
    NEGATIVE,
    Model,
    ModelObject,
    Package,
    Reference,
    damaged,
)
from .triangles import Triangles

_MAX_DEPTH = 64  # of components in components
_MAX_PIECES, _MAX_TRIANGLES = 2**14, 2**26  # of all uses of all objects
_UNPRINTABLE = "item that is marked as not printable"


@dataclass(frozen=True)
class _Piece:
    """Triangles of one use of an object: vertices (n, 3), faces (m, 3), and their kind."""

    vertices: Float
    faces: Int
    kind: str


def read_3mf(path: Path) -> Triangles:
    """Read the triangles of the body, mm: all build items that are printed.

    Supports, modifiers, and items and objects of other types are left out with a note. Negative
    volumes are subtracted.

    Args:
        path: The file.

    Raises:
        BodyError: The file is damaged (`file-invalid`), or holds no body (`no-body-object`) or a
            shape that is not read (`beam-lattice`, `shape-unsupported`, `extension-unsupported`,
            `volume-kind-unknown`, `negative-volume`).
    """
    reader = _BodyReader(Package(path))
    vertices, faces, offset = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for piece in reader.body():
        vertices.append(piece.vertices)
        faces.append(piece.faces + offset)
        offset += len(piece.vertices)
    notes = reader.notes()
    if len(faces) == 1 and notes:
        raise BodyError(
            f"holds no body: {', '.join(notes)}",
            code="no-body-object",
            action="Export the body as a printable object of type model",
        )
    unit = reader.unit
    return Triangles(unit * np.concatenate(vertices), np.concatenate(faces), notes, unit)


class _BodyReader:
    """Collects the triangles of the body from the objects of a 3MF file."""

    def __init__(self, package: Package) -> None:
        self._package = package
        self._volumes = package.read_volume_kinds()
        self._main = package.model_path()
        self._models: dict[str, Model] = {}
        self._left_out: Counter[str] = Counter()
        self._subtracted = 0
        self._pieces = self._triangles = 0
        self.unit = self._model(self._main).unit

    def notes(self) -> tuple[str, ...]:
        """Return sentences on what was left out and subtracted."""
        notes = [f"left out {_counted(kind, n)}" for kind, n in self._left_out.items()]
        if self._subtracted:
            notes.append(f"subtracted {_counted(NEGATIVE, self._subtracted)}")
        return tuple(notes)

    def body(self) -> list[_Piece]:
        """Return the pieces of all items, without those that are not the body."""
        pieces: list[_Piece] = []
        for item in self._model(self._main).items:
            if not item.is_printable:
                self._left_out[_UNPRINTABLE] += 1
                continue
            parts: list[_Piece] = []
            self._collect(item, self._main, np.eye(4)[:, :3], "", 0, parts)
            for part in parts:
                if part.kind not in ("", NEGATIVE):
                    self._left_out[part.kind] += 1
            positive = [part for part in parts if not part.kind]
            negative = [part for part in parts if part.kind == NEGATIVE]
            if positive and negative:
                self._subtracted += len(negative)
                positive = [_subtract(positive, negative)]
            elif negative:
                self._left_out[NEGATIVE] += len(negative)
            pieces += positive
        return pieces

    def _model(self, path: str) -> Model:
        if path not in self._models:
            self._models[path] = self._package.read_model(path)
        return self._models[path]

    def _collect(
        self,
        use: Reference,
        path: str,
        outer: Float,
        kind: str,
        depth: int,
        pieces: list[_Piece],
    ) -> None:
        """Add the pieces of an object that is used in the file `path`."""
        path = use.path or path
        is_main = path == self._main
        found = self._model(path).objects.get(use.object_id)
        if found is None:
            raise damaged(f"uses the object {use.object_id}, which does not exist")
        if depth > _MAX_DEPTH:
            raise damaged(f"the object {use.object_id} is nested too deep, or contains itself")
        kind = kind or _object_kind(found)
        matrix = _compose(use.matrix, outer)
        if kind in ("", NEGATIVE):
            _check_shapes(found)
        if len(found.triangles):
            ranges = self._volumes.ranges.get(use.object_id, ()) if is_main else ()
            for piece in _mesh_pieces(found, use.object_id, matrix, ranges):
                pieces.append(_Piece(piece.vertices, piece.faces, kind or piece.kind))
                self._triangles += len(piece.faces)
        for component in found.components:
            part = (use.object_id, component.object_id)
            part_kind = self._volumes.parts.get(part, "") if is_main else ""
            self._collect(component, path, matrix, kind or part_kind, depth + 1, pieces)
        self._pieces += 1
        if self._pieces > _MAX_PIECES or self._triangles > _MAX_TRIANGLES:
            raise MemoryError


def _object_kind(found: ModelObject) -> str:
    """Return what an object is by its type and by the settings of Cura; empty for a body."""
    if found.kind != "model":
        return f"object of type {found.kind[:20]}"
    for name, kind in CURA_KINDS.items():
        if found.metadata.get(name, "").strip().lower() == "true":
            return kind
    return ""


def _check_shapes(found: ModelObject) -> None:
    """Check that an object of the body has no shape but its triangles and components."""
    if "beamlattice" in found.shapes:
        besides = "in addition to its mesh" if len(found.triangles) else "not a mesh"
        raise BodyError(
            f"holds a beam lattice, {besides}",
            code="beam-lattice",
            action="Export the surface of the lattice as a mesh",
        )
    has_mesh = len(found.triangles) or found.components
    if found.shapes and (not has_mesh or "slicestack" in found.shapes):
        raise BodyError(
            f"holds a {found.shapes[0][:40]}, not a mesh",
            code="shape-unsupported",
            action="Export the body as a mesh",
            shape=found.shapes[0],
        )


def _mesh_pieces(
    found: ModelObject,
    number: int,
    matrix: Float,
    ranges: tuple[()] | list[tuple[int, int, str]],
) -> list[_Piece]:
    """Return the mesh of an object: whole, or as the volumes that slicers divide it into."""
    vertices = np.array(found.vertices, np.float64).reshape(-1, 3)
    faces = np.array(found.triangles, np.int64).reshape(-1, 3)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise BodyError(
            f"a triangle of the object {number} names a vertex that does not exist",
            code="vertex-missing",
        )
    points = (_turn(vertices, matrix) + matrix[3].astype(np.float32)).astype(np.float64)
    if np.linalg.det(matrix[:3]) < 0:
        faces = faces[:, ::-1]
    kinds, names = np.zeros(len(faces), np.int64), [""]
    for first, last, kind in ranges:
        if not 0 <= first <= last + 1 <= len(faces):
            raise damaged(f"a volume of the object {number} ends at triangle {last}")
        kinds[first : last + 1] = len(names)
        names.append(kind)
    if all(name == "" for name in names):
        return [_Piece(points, faces, "")]
    return [
        _Piece(points, faces[kinds == k], name)
        for k, name in enumerate(names)
        if (kinds == k).any()
    ]


def _compose(inner: Float, outer: Float) -> Float:
    """Return the transform (4, 3) of row vectors by `inner`, then by `outer`."""
    matrix = _turn(inner, outer)
    matrix[3] += outer[3]
    return matrix


def _turn(rows: Float, matrix: Float) -> Float:
    """Return row vectors (n, 3) after the linear part of a transform, in single precision.

    The order of the additions is that of lib3mf, so that both place vertices alike, bit for bit.
    """
    a, b, c = rows.astype(np.float32).T[:, :, None]
    x, y, z = matrix[:3].astype(np.float32)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray((a * x + b * y) + c * z)


def _subtract(positive: list[_Piece], negative: list[_Piece]) -> _Piece:
    """Return the volumes of an object without its negative volumes.

    Raises:
        BodyError: A volume is not closed (`negative-volume`).
    """
    from ...kernels import triangle_kernel

    solids = []
    for piece in (*positive, *negative):
        used, faces = np.unique(piece.faces, return_inverse=True)
        surface = Surface(piece.vertices[used], faces.reshape(-1, 3).astype(np.int64))
        solid = triangle_kernel.try_manifold(surface)
        if solid is None or solid.volume() <= 0:
            raise BodyError(
                f"holds a {NEGATIVE} to be subtracted, and a volume that is not closed",
                code="negative-volume",
                action="Subtract the volume in the slicer, and export the result as STL",
            )
        solids.append(solid)
    count = len(positive)
    rest = triangle_kernel.union(solids[:count]) - triangle_kernel.union(solids[count:])
    surface = triangle_kernel.to_surface(rest)
    return _Piece(surface.vertices, surface.faces, "")


def _counted(kind: str, count: int) -> str:
    """Return a number of objects in words, such as "2 objects of type support"."""
    if count == 1:
        return f"1 {kind}"
    for noun in ("object", "item"):
        if kind.startswith(f"{noun} "):
            verb = kind.removeprefix(noun).replace("that is ", "that are ")
            return f"{count} {noun}s{verb}"
    return f"{count} {kind}s"
