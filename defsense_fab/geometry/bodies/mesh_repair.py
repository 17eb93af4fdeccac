"""Read triangle meshes and repair them to one closed surface, or refuse where that would be a
guess.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import BodyError
from ...core.mesh import Surface
from .mesh_files import SUFFIXES_WITH_UNIT, detect_format, read_triangles
from .repair.connectivity import clean_triangles, separate_sheets
from .repair.findings import check_distance_from_origin, describe_point, format_count
from .repair.holes import close_holes
from .repair.solid import make_one_solid, orient_faces, rebuild_solid

MAX_TRIES = 4
#: Plausible size in a file's lengths, in units from micrometres to metres.
ANY_UNIT_RANGE = (1e-6, 1e9)


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
        BodyError: If the file cannot be read, or the body has an implausible size, lies far from
            the origin, has wide holes, several pieces or cavities, encloses no volume, or cannot be
            repaired.
    """
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


def repair_mesh(
    vertices: Float, faces: Int, where: str, fill_cavities: bool = False
) -> tuple[Float, Int, list[str]]:
    """Repair triangles to one closed surface that does not pass through itself, turned outward.

    Args:
        vertices: Corners (n, 3), mm.
        faces: Triangles (m, 3).
        where: File to name in errors.
        fill_cavities: Whether closed cavities are filled; otherwise they are an error.

    Returns:
        Vertices, faces, and a sentence on each repair: its place, how far it moved the surface, and
        how it changed the volume.

    Raises:
        BodyError: As `read_mesh`.
    """
    size = float(np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0)))
    vertices, faces, sentences = clean_triangles(vertices, faces, size)
    if len(faces) == 0:
        raise BodyError(
            "encloses no volume",
            code="encloses-no-volume",
            where=where,
            action="Give a closed solid",
        )
    oriented = orient_faces(faces)
    if (oriented != faces).any():
        sentences.append("turned inconsistent faces")
    vertices, faces, closings = close_holes(vertices, oriented, size, where)
    sentences += closings
    if closings:
        faces = orient_faces(faces)
    at, replaced = vertices[faces[0, 0]], 0
    for rings in range(MAX_TRIES):
        sheets = separate_sheets(vertices, faces, size)
        if isinstance(sheets, tuple):
            if replaced:
                count = format_count(replaced, "triangle")
                sentences.append(
                    f"replaced {count} at edges that have more than two, near {describe_point(at)}"
                )
            v, f, notes = make_one_solid(*sheets[:2], size, where, fill_cavities)
            return v, f, sentences + sheets[2] + notes
        # Triangles that cannot be joined to others are removed, and the holes are filled.
        is_removed = sheets
        at = vertices[faces[is_removed][0]].mean(0)
        for _ in range(rings):
            is_removed = np.asarray(np.isin(faces, faces[is_removed]).any(1))
        replaced += int(is_removed.sum())
        try:
            vertices, faces, _ = close_holes(vertices, faces[~is_removed], size, where)
        except BodyError:
            break
        faces = orient_faces(faces)
    problem = f"edges have more than two faces, one near {describe_point(at)}"
    v, f, notes = rebuild_solid(vertices, faces, size, where, problem, fill_cavities)
    return v, f, sentences + notes
