"""Meshes made before, by the body they are of.

The mesher is not repeatable and the optimiser follows the mesh, so without this the same body
would give slightly different parts in every new folder.
"""

from __future__ import annotations

import contextlib
import os
from importlib.metadata import version
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from platformdirs import user_cache_path

from ...core.errors import StorageError
from ...core.files import digest, replacing
from ...core.mesh import Surface, TetMesh

#: Raised when meshes of the same body are to be made anew.
VERSION = 1
#: Oldest meshes go when there are more.
KEPT = 100


def folder() -> Path:
    """`DEFSENSE_CACHE`, or the user's cache folder."""
    chosen = os.environ.get("DEFSENSE_CACHE")
    return Path(chosen) if chosen else user_cache_path("defsense-fab") / "meshes"


def _path(surface: Surface, edge_length: float) -> Path:
    rounded = np.round(surface.vertices, 6) + 0.0  # no negative zeros
    key = digest(
        VERSION, version("pytetwild"), edge_length, rounded.tobytes(), surface.faces.tobytes()
    )
    return folder() / f"{key}.npz"


def recall(surface: Surface, edge_length: float) -> TetMesh | None:
    """The mesh of this surface and edge length (mm), where one was made on this machine."""
    path = _path(surface, edge_length)
    try:
        with path.open("rb") as file, np.load(file) as data:
            mesh = TetMesh(data["nodes"], data["tets"])
        os.utime(path)
    except (OSError, EOFError, ValueError, KeyError, BadZipFile):
        return None  # none, or not readable: it is made anew
    return mesh


def remember(surface: Surface, edge_length: float, mesh: TetMesh) -> None:
    """Keep the mesh. A cache that cannot be written must not stop a build."""
    path = _path(surface, edge_length)
    with contextlib.suppress(OSError, StorageError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            np.savez(temporary, nodes=mesh.nodes, tets=mesh.tets)
        meshes = sorted(path.parent.glob("*.npz"), key=lambda p: -p.stat().st_mtime)
        for old in meshes[KEPT:]:
            old.unlink(missing_ok=True)
