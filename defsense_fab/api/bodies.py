"""Bodies as Python has them, written as the file that a device names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import BodyError
from ..core.mesh import Surface
from ..core.storage.files import storage_errors
from ..geometry.kernels.export import write_stl
from ..pipeline.starts.dropped_body import look_at

_MM = "bodies are in mm"


def write_body(body: object, folder: Path) -> dict[str, Any]:
    """The table `[body]` of a file that is written into the `folder`: of a path to STEP, a mesh or
    a script; of a build123d shape or builder; of a trimesh.Trimesh, or anything else with
    `vertices` (n, 3) mm and `faces` (m, 3). Raises BodyError for what is none of these."""
    if isinstance(body, str | Path):
        return _copied(Path(body), folder)
    if hasattr(body, "vertices") and hasattr(body, "faces") and not callable(body.vertices):
        write_stl(_surface(body.vertices, body.faces), folder / "body.stl")
        return {"mesh": "body.stl"}
    shape = getattr(body, "part", body)  # a builder's, or the shape itself
    solid = getattr(shape, "wrapped", None)
    if solid is None:
        raise BodyError(
            f"body: {type(body).__name__} is no body; give a path, a build123d shape, a trimesh, or"
            " a Surface"
        )
    from ..geometry.kernels import occ

    occ.write_step(solid, folder / "body.step", "body")
    return {"step": "body.step"}


def _copied(path: Path, folder: Path) -> dict[str, Any]:
    """With the files beside a script that it reads."""
    found = look_at(path)
    name = f"{found.name}{found.suffix}"
    with storage_errors(folder):
        for inner, content in {name: found.content, **found.others}.items():
            target = folder / inner
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
    return {found.key: name}


def _surface(vertices: Any, faces: Any) -> Surface:
    try:
        return Surface(np.asarray(vertices, float), np.asarray(faces, np.int64))
    except (TypeError, ValueError) as error:
        raise BodyError(f"body: {error}; {_MM}") from None
