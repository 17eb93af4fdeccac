"""Bodies as Python has them, written as the file that a device names."""

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
from .starts.dropped_body import choose_unit
from .starts.dropped_body import DroppedBody, load_body_file, notable_repairs
from .starts.first_device import check_edge_length
from .starts.units import parse_unit, describe_unusual_size


def write_body(
    body: object, units: str | None, edge_length: float, folder: Path
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The table `[body]` of a file that is written into the `folder`, and notes: what was repaired,
    and whether its size is unusual. The body is a path to STEP, a mesh or a script; a build123d
    shape or builder; a trimesh.Trimesh, or anything else with `vertices` (n, 3) and `faces` (m, 3).
    A mesh is in these `units`, and its elements have edges of `edge_length` mm. Raises BodyError
    for what is none of these, DeviceError for units that cannot be, or must be given, and for edges
    that do not suit the body."""
    if units is not None:
        parse_unit(of_kind(units, "units", str))
    found = _found(body)
    unit = choose_unit(found, units, 'units="{}"')
    check_edge_length(found, unit, number(edge_length, "edge_length"))
    name = f"{found.name}{found.suffix}"
    with storage_errors(folder):
        for inner, content in {name: found.content, **found.others}.items():
            target = folder / inner
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
    size = describe_unusual_size(found.size(unit))
    notes = [f"the body was mended: {line}" for line in notable_repairs(found.repairs(unit))]
    return found.table(name, unit), (*notes, *([size] if size else []))


def _found(body: object) -> DroppedBody:
    if isinstance(body, str | os.PathLike):
        return load_body_file(path(body, "body", BodyError))
    with tempfile.TemporaryDirectory(prefix="defsense-") as made, storage_errors(Path(made)):
        return load_body_file(_file_of(body, Path(made)))


def _file_of(body: Any, folder: Path) -> Path:
    """A file in the `folder`, in the unit of the body."""
    if hasattr(body, "vertices") and hasattr(body, "faces") and not callable(body.vertices):
        write_stl(_surface(body), folder / "body.stl")
        return folder / "body.stl"
    shape = getattr(body, "part", body)  # a builder's, or the shape itself
    solid = getattr(shape, "wrapped", None)
    if solid is None:
        raise BodyError(
            f"body: must be a path, a build123d shape, a trimesh or a Surface, not {shown(body)}"
        )
    from ..geometry.kernels import occ

    occ.write_step(solid, folder / "body.step", "body")
    return folder / "body.step"


def _surface(body: Any) -> Surface:
    vertices = array(body.vertices, "body.vertices", BodyError)
    faces = array(body.faces, "body.faces", BodyError)
    if not faces.size:
        raise BodyError("body: has no triangles")
    if not ((faces >= 0) & (faces < len(vertices)) & (faces % 1 == 0)).all():
        raise BodyError(
            f"body.faces: must be whole numbers of the {len(vertices)} vertices, from 0 on"
        )
    try:
        return Surface(vertices, faces.astype(np.int64))
    except (TypeError, ValueError) as error:
        raise BodyError(f"body: {error}") from None
