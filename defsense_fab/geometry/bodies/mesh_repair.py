"""Triangle meshes: read, made into one closed surface, and refused where that is a guess."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import BodyError
from ...core.mesh import Surface
from .mesh_files import IN_MM, kind_of_file, read_triangles
from .repair.connectivity import cleaned, taken_apart
from .repair.findings import check_near, number, place
from .repair.holes import close_holes
from .repair.solid import one_solid, oriented, remade_solid

_TRIES = 4
#: What a file's lengths may be in some unit: from micrometres to metres.
_ANY_UNIT = (1e-6, 1e9)


def read_mesh(
    path: Path, scale: float, sizes: tuple[float, float], fill_cavities: bool = False
) -> tuple[Surface, tuple[str, ...], float]:
    """The closed surface in `path` times `scale`, what was repaired, and the mm of the file's unit,
    1 where it has none.

    What kind of file it is, its content says. Raises BodyError for an unreadable file, a size
    outside `sizes` mm, a place far from the origin for these, holes too wide to close, several
    separate pieces, cavities unless they are to be filled, no enclosed volume, or a surface that
    cannot be repaired.
    """
    suffix = _suffix(path)
    read = read_triangles(path, suffix)
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = read.vertices * scale
        in_file = float(np.linalg.norm(np.ptp(read.vertices[np.unique(read.faces)], axis=0)))
        size = in_file * scale
    if not _ANY_UNIT[0] <= in_file <= _ANY_UNIT[1]:
        raise BodyError(
            f"{path}: the body is {in_file:.3g} across in the file's lengths, of which no unit"
            " makes a device; export it again",
            code="unlikely-size",
            size=in_file,
        )
    if not sizes[0] <= size <= sizes[1]:
        unit = (
            "the file's lengths were taken as its format has them"
            if suffix in IN_MM
            else "1000 where the file is in metres, 25.4 for inches"
        )
        raise BodyError(
            f"{path}: the body is {size:.3g} mm across; set [body] scale in device.toml ({unit})",
            code="unlikely-size",
            size=size,
        )
    check_near(str(path), vertices[read.faces], sizes[1])
    vertices, faces, repairs = repair(vertices, read.faces, str(path), fill_cavities)
    return Surface(vertices, faces), (*_renamed(path, suffix), *read.told, *repairs), read.unit


def _suffix(path: Path) -> str:
    """The kind of file, by its content, and where that tells nothing by its name."""
    try:
        kind = kind_of_file(path.read_bytes())
    except OSError as error:
        raise BodyError(
            f"{path}: cannot be read: {error.strerror}", code="file-unreadable"
        ) from None
    if kind == ".step":
        raise BodyError(
            f'{path}: is a STEP file; write step = "{path.name}" under [body]',
            code="wrong-file-format",
            suffix=kind,
        )
    return kind or path.suffix.lower()


def _renamed(path: Path, suffix: str) -> tuple[str, ...]:
    if path.suffix.lower() in (suffix, ""):
        return ()
    return (f"read as {suffix[1:].upper()}, which the file is in spite of its name",)


def repair(
    vertices: Float, faces: Int, where: str, fill_cavities: bool = False
) -> tuple[Float, Int, list[str]]:
    """One closed surface that does not pass through itself, turned outward, and what was done: each
    repair with its place, how far it moved the surface (mm), and what it did to the volume.

    Raises BodyError as `read_mesh` does.
    """
    size = float(np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0)))
    vertices, faces, done = cleaned(vertices, faces, size)
    if len(faces) == 0:
        raise BodyError(
            f"{where}: encloses no volume; a closed solid is needed", code="encloses-no-volume"
        )
    turned = oriented(faces)
    if (turned != faces).any():
        done.append("turned inconsistent faces")
    vertices, faces, closed = close_holes(vertices, turned, size, where)
    done += closed
    if closed:
        faces = oriented(faces)
    at, replaced = vertices[faces[0, 0]], 0
    for rings in range(_TRIES):
        apart = taken_apart(vertices, faces, size)
        if isinstance(apart, tuple):
            if replaced:
                many = number(replaced, "triangle")
                done.append(f"replaced {many} at edges that have more than two, near {place(at)}")
            v, f, told = one_solid(*apart[:2], size, where, fill_cavities)
            return v, f, done + apart[2] + told
        # Triangles that are joined to others in no sensible way give place to ones that are.
        gone = apart
        at = vertices[faces[gone][0]].mean(0)
        for _ in range(rings):
            gone = np.asarray(np.isin(faces, faces[gone]).any(1))
        replaced += int(gone.sum())
        try:
            vertices, faces, _ = close_holes(vertices, faces[~gone], size, where)
        except BodyError:
            break
        faces = oriented(faces)
    why = f"edges have more than two faces, one near {place(at)}"
    v, f, told = remade_solid(vertices, faces, size, where, why, fill_cavities)
    return v, f, done + told
