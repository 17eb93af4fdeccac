"""Detect the format of mesh files, and read their triangles as a repaired surface."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...core.errors import BodyError
from ...core.mesh import Surface
from ...core.storage.text import find_encoding
from .formats.gltf import read_gltf
from .formats.obj import read_obj
from .formats.off import OFF_HEADER, read_off
from .formats.ply import read_ply
from .formats.stl import is_stl, read_stl
from .formats.tetrahedra import TET_SUFFIXES, read_cells
from .formats.text import decode_text
from .formats.threemf import read_3mf
from .formats.triangles import Triangles
from .repair.findings import check_distance_from_origin

_STEP = re.compile(rb"\s*(?>/\*.*?\*/\s*)*+ISO-10303-21\s*;", re.DOTALL)
_VERTEX = re.compile(rb"(?:^|[\r\n])[ \t]*v[ \t]+[-+.\d]")
_FACE = re.compile(rb"(?:^|[\r\n])[ \t]*fo?[ \t]+(?:\\\s+)?[-+\d]")
_MEDIT = re.compile(rb"\s*(?>#[^\n]*\n\s*)*+MeshVersionFormatted\b")
_VTU = re.compile(
    rb"\s*(<\?xml[^>]*>\s*)?(?><!--.*?-->\s*)*+<VTKFile\b[^>]*UnstructuredGrid", re.DOTALL
)
_GLTF = re.compile(rb'\s*\{.*"asset"\s*:', re.DOTALL)
_MSH = re.compile(rb"\s*\$(MeshFormat|Comments)\b")
HEAD_BYTES = 4096


def detect_format(content: bytes) -> str | None:
    """Detect what kind of body a file holds from its content.

    Args:
        content: Bytes of the file.

    Returns:
        The usual suffix of the format (.step, .stl, .obj, .ply, .off, .3mf, .glb, .gltf, .msh, .vtu
        or .mesh), or None if it is none of them. The file may still be unreadable.
    """
    start = decode_text(content[:HEAD_BYTES])
    for suffix, pattern in (
        (".step", _STEP),
        (".off", OFF_HEADER),
        (".mesh", _MEDIT),
        (".vtu", _VTU),
        (".msh", _MSH),
    ):
        if pattern.match(start):
            return suffix
    if re.match(rb"ply\s", start):
        return ".ply"
    if start.startswith(b"glTF"):
        return ".glb"
    if start.startswith(b"PK\x03\x04") and b"3D/" in content:
        return ".3mf"
    if is_stl(content):
        return ".stl"
    if b"\0" in start:
        return None
    if find_encoding(content)[1].startswith("utf-16"):
        content = decode_text(content)
    if start.lstrip().startswith(b"{") and _GLTF.match(content) and b'"meshes"' in content:
        return ".gltf"
    if _VERTEX.search(content) and _FACE.search(content):
        return ".obj"
    return None


#: Suffixes of the files that are read.
SUFFIXES = (".stl", ".obj", ".ply", ".off", ".3mf", ".glb", ".gltf", *TET_SUFFIXES)
#: Plausible size in a file's lengths, in units from micrometres to metres.
ANY_UNIT_RANGE = (1e-6, 1e9)
#: Suffixes of formats whose lengths have a unit.
SUFFIXES_WITH_UNIT = (".3mf", ".glb", ".gltf")
#: Names of the formats for messages.
FORMAT_NAMES = "STL, OBJ, PLY, OFF, 3MF, GLB, or tetrahedra in .msh, .vtu or .mesh"


def read_triangles(path: Path, suffix: str) -> Triangles:
    """Read the triangles of a mesh file. Other files that it names are not read.

    Args:
        path: The file.
        suffix: Suffix of its format.

    Raises:
        BodyError: If the file cannot be read.
    """
    if suffix not in SUFFIXES:
        raise BodyError(
            "has an unknown format",
            code="unknown-format",
            where=path,
            action=f"Give {FORMAT_NAMES}",
            suffix=suffix,
        )
    try:
        mesh = _read(path, suffix)
    except BodyError as error:  # readers of content do not know the file
        error.where = error.where or str(path)
        raise
    except MemoryError:
        raise BodyError(
            "is too large to be read, or claims to be",
            code="file-too-large",
            where=path,
            action="Write the file again from the program that made it",
        ) from None
    # Libraries raise whatever their parsers raise, and meshio ends the program.
    except (Exception, SystemExit) as error:
        raise BodyError(
            f"cannot be read as {suffix[1:].upper()}: it is damaged",
            code="file-invalid",
            where=path,
            action="Write the file again from the program that made it",
            suffix=suffix,
        ) from error
    vertices, faces = mesh.vertices, mesh.faces
    if len(faces) == 0:
        raise BodyError("holds no triangles", code="no-triangles", where=path)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise BodyError(
            "a triangle names a vertex that does not exist", code="vertex-missing", where=path
        )
    if not np.isfinite(vertices).all():
        raise BodyError("a vertex is not a finite number", code="not-finite", where=path)
    return mesh


def _read(path: Path, suffix: str) -> Triangles:
    """Read the triangles of a file of a known format."""
    if suffix == ".3mf":
        return read_3mf(path)
    if suffix in TET_SUFFIXES:
        return read_cells(path, suffix)
    if suffix in (".glb", ".gltf"):
        return read_gltf(path, suffix)
    readers = {".stl": read_stl, ".obj": read_obj, ".off": read_off, ".ply": read_ply}
    return readers[suffix](path.read_bytes())


def read_mesh(
    path: Path, scale: float, sizes: tuple[float, float], fill_cavities: bool = False
) -> tuple[Surface, tuple[str, ...], float]:
    """Read a mesh file and repair its surface.

    The format is detected from the content.

    Args:
        path: The file.
        scale: Factor from the file's lengths to mm.
        sizes: Smallest and largest plausible size, mm.
        fill_cavities: Whether closed cavities are filled; otherwise they are an error.

    Returns:
        The closed surface, mm; sentences on what was repaired; and the millimetres of the file's
        unit, 1 if its format has none.

    Raises:
        BodyError: As `repair_mesh`, or if the file cannot be read, or the body has an implausible
            size or lies far from the origin.
    """
    from .repair.mesh_repair import repair_mesh  # only the process that reads meshes needs it

    suffix = _detect_suffix(path)
    mesh = read_triangles(path, suffix)
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = mesh.vertices * scale
        in_file = float(np.linalg.norm(np.ptp(mesh.vertices[np.unique(mesh.faces)], axis=0)))
        size = in_file * scale
    if not ANY_UNIT_RANGE[0] <= in_file <= ANY_UNIT_RANGE[1]:
        raise BodyError(
            f"the body is {in_file:.3g} across in the file's lengths, which is implausible in"
            f" any unit",
            code="unlikely-size",
            where=path,
            action="Export it again",
            size=in_file,
        )
    if not sizes[0] <= size <= sizes[1]:
        unit_hint = (
            "the file's lengths were read in the unit of its format"
            if suffix in SUFFIXES_WITH_UNIT
            else "1000 where the file is in metres, 25.4 for inches"
        )
        raise BodyError(
            f"the body is {size:.3g} mm across",
            code="unlikely-size",
            where=path,
            action=f"Set [body] scale in device.toml ({unit_hint})",
            size=size,
        )
    check_distance_from_origin(str(path), vertices[mesh.faces], sizes[1])
    vertices, faces, repairs = repair_mesh(vertices, mesh.faces, str(path), fill_cavities)
    return (
        Surface(vertices, faces),
        (*_describe_format(path, suffix), *mesh.notes, *repairs),
        mesh.unit,
    )


def _detect_suffix(path: Path) -> str:
    """Return the suffix of the format, by content or else by name."""
    try:
        suffix = detect_format(path.read_bytes())
    except OSError as error:
        raise BodyError(
            f"cannot be read: {error.strerror}", code="file-unreadable", where=path
        ) from None
    if suffix == ".step":
        raise BodyError(
            "is a STEP file",
            code="wrong-file-format",
            where=path,
            action=f'Write step = "{path.name}" under [body]',
            suffix=suffix,
        )
    return suffix or path.suffix.lower()


def _describe_format(path: Path, suffix: str) -> tuple[str, ...]:
    if path.suffix.lower() in (suffix, ""):
        return ()
    return (f"read as {suffix[1:].upper()}, the format of its content in spite of its name",)
