"""Write a body that is given as a Python value into a device's folder."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import BodyError
from ..core.mesh import Surface
from ..core.storage.files import storage_errors
from ..geometry.printing.export import write_stl
from .arguments import array, number, of_kind, path, shown
from .starts.body_file import (
    BodyFile,
    choose_unit,
    describe_unusual_size,
    load_body_file,
    notable_repairs,
    scale_to_size,
)
from .starts.first_device import check_edge_length
from .starts.options import check_unit_or_size


def write_body(
    body: object, units: str | None, edge_length: float, folder: Path, size: float | None = None
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Write the files of a body into a folder.

    Args:
        body: Path to a STEP file, a mesh or a script; a build123d shape or builder; a
            `trimesh.Trimesh`, or another object with `vertices` (n, 3) and `faces` (m, 3).
        units: Unit of a mesh; None: the unit of its file, or mm.
        edge_length: Edge length of the tetrahedra, mm.
        folder: The folder.
        size: Longest side of a mesh, mm, in place of its unit.

    Returns:
        The table `[body]` of `device.toml`, and notes on repairs and on an unusual size.

    Raises:
        BodyError: The value is not a body.
        DeviceError: The unit is invalid or must be given, or the edge length does not suit the
            body.
    """
    check_unit_or_size(
        None if units is None else of_kind(units, "units", str),
        None if size is None else number(size, "size", above=0),
    )
    file = scale_to_size(_load(body), size)
    unit = choose_unit(file, units)
    check_edge_length(file, unit, number(edge_length, "edge_length"))
    name = f"{file.name}{file.suffix}"
    with storage_errors(folder):
        for relative, content in {name: file.content, **file.others}.items():
            target = folder / relative
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
    warning = describe_unusual_size(file.size(unit))
    notes = [f"the body was repaired: {line}" for line in notable_repairs(file.repairs(unit))]
    return file.table(name, unit), (*notes, *([warning] if warning else []))


def _load(body: object) -> BodyFile:
    if isinstance(body, str | os.PathLike):
        return load_body_file(path(body, "body", BodyError))
    with tempfile.TemporaryDirectory(prefix="defsense-") as name, storage_errors(Path(name)):
        return load_body_file(_write_file(body, Path(name)))


def _write_file(body: Any, folder: Path) -> Path:
    """Write a mesh as STL or a solid as STEP, in the unit of the body, and return the file."""
    if hasattr(body, "vertices") and hasattr(body, "faces") and not callable(body.vertices):
        write_stl(_surface(body), folder / "body.stl")
        return folder / "body.stl"
    shape = getattr(body, "part", body)  # of a builder, or the shape itself
    solid = getattr(shape, "wrapped", None)
    if solid is None:
        raise BodyError(
            f"must be a path, a build123d shape, a trimesh or a Surface, not {shown(body)}",
            code="not-a-body",
            where="body",
            argument="body",
        )
    from ..geometry.kernels import occ

    occ.write_step(solid, folder / "body.step", "body")
    return folder / "body.step"


def _surface(body: Any) -> Surface:
    vertices = array(body.vertices, "body.vertices", BodyError)
    faces = array(body.faces, "body.faces", BodyError)
    if not faces.size:
        raise BodyError("has no triangles", code="mesh-empty", where="body", argument="body")
    if not ((faces >= 0) & (faces < len(vertices)) & (faces % 1 == 0)).all():
        raise BodyError(
            f"must be whole numbers from 0 to {len(vertices) - 1}, the numbers of the vertices",
            code="unknown-vertex",
            where="body.faces",
            argument="body.faces",
        )
    try:
        return Surface(vertices, faces.astype(np.int64))
    except (TypeError, ValueError) as error:
        raise BodyError(str(error), code="not-a-surface", where="body", argument="body") from None
