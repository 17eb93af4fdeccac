"""Cache meshes by body and edge length, since meshing takes seconds to minutes."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, fields
from importlib.metadata import version
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from platformdirs import user_cache_path

from ....core.errors import StorageError
from ....core.mesh import Surface, TetMesh
from ....core.storage.files import digest, replace_file
from .tetrahedra import MeshedSurface, Tetrahedra

#: Increase this to mesh all bodies again.
CACHE_VERSION = 4
#: Number of meshes in the cache; the oldest are deleted.
MAX_MESHES = 100


def cache_folder() -> Path:
    """Return `DEFSENSE_CACHE`, or else the user's cache folder."""
    folder = os.environ.get("DEFSENSE_CACHE")
    return Path(folder) if folder else user_cache_path("defsense-fab") / "meshes"


def _path(surface: Surface, edge_length: float) -> Path:
    vertices = np.round(surface.vertices, 6) + 0.0  # no negative zeros
    meshers = version("netgen-mesher"), version("pytetwild")
    key = digest(CACHE_VERSION, meshers, edge_length, vertices.tobytes(), surface.faces.tobytes())
    return cache_folder() / f"{key}.npz"


def to_json(tetrahedra: Tetrahedra) -> str:
    """Return all fields but the mesh as JSON."""
    data = {f.name: getattr(tetrahedra, f.name) for f in fields(tetrahedra) if f.name != "mesh"}
    surface = asdict(tetrahedra.surface) if tetrahedra.surface else None
    return json.dumps(data | {"surface": surface})


def from_json(mesh: TetMesh, text: str) -> Tetrahedra:
    """Add a mesh to the fields that `to_json` returned.

    Raises:
        ValueError: The text is not JSON.
        KeyError: A field is missing.
        TypeError: A field is unknown or of the wrong type.
    """
    data = json.loads(text)
    surface = MeshedSurface(**data.pop("surface")) if data["surface"] else data.pop("surface")
    return Tetrahedra(mesh, surface=surface, **data | {"tried": tuple(data["tried"])})


def load_cached_mesh(surface: Surface, edge_length: float, time_limit: float) -> Tetrahedra | None:
    """Load the mesh of a surface from the cache of this machine.

    Args:
        surface: Surface of the body.
        edge_length: Edge length in mm.
        time_limit: Time limit of meshing in s.

    Returns:
        The mesh; None if there is none, if it is unreadable, or if this time limit would improve
        it.
    """
    path = _path(surface, edge_length)
    try:
        with path.open("rb") as file, np.load(file) as data:
            mesh = TetMesh(data["nodes"], data["tets"])
            tetrahedra = from_json(mesh, str(data["told"]))
        os.utime(path)
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile):
        return None
    return None if tetrahedra.is_outgrown(time_limit) else tetrahedra


def cache_mesh(surface: Surface, edge_length: float, tetrahedra: Tetrahedra) -> None:
    """Store a mesh in the cache, if possible: an unwritable cache must not stop a build.

    Args:
        surface: Surface of the body.
        edge_length: Edge length in mm.
        tetrahedra: Mesh of the surface.
    """
    path = _path(surface, edge_length)
    with contextlib.suppress(OSError, StorageError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as temporary:
            np.savez(
                temporary,
                nodes=tetrahedra.mesh.nodes,
                tets=tetrahedra.mesh.tets,
                told=to_json(tetrahedra),
            )
        meshes = sorted(path.parent.glob("*.npz"), key=lambda p: -p.stat().st_mtime)
        for old in meshes[MAX_MESHES:]:
            old.unlink(missing_ok=True)
