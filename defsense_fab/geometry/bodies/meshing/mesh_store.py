"""Meshes made before, by the body they are of: meshing takes seconds to minutes."""

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

#: Raised when meshes of the same body are to be made anew.
VERSION = 4
#: Oldest meshes go when there are more.
KEPT = 100


def folder() -> Path:
    """`DEFSENSE_CACHE`, or the user's cache folder."""
    chosen = os.environ.get("DEFSENSE_CACHE")
    return Path(chosen) if chosen else user_cache_path("defsense-fab") / "meshes"


def _path(surface: Surface, edge_length: float) -> Path:
    rounded = np.round(surface.vertices, 6) + 0.0  # no negative zeros
    meshers = version("netgen-mesher"), version("pytetwild")
    key = digest(VERSION, meshers, edge_length, rounded.tobytes(), surface.faces.tobytes())
    return folder() / f"{key}.npz"


def told(made: Tetrahedra) -> str:
    """All but the mesh, as JSON."""
    rest = {f.name: getattr(made, f.name) for f in fields(made) if f.name != "mesh"}
    return json.dumps(rest | {"surface": asdict(made.surface) if made.surface else None})


def made_as(mesh: TetMesh, words: str) -> Tetrahedra:
    """Raises ValueError, KeyError, TypeError for what is not written by `told`."""
    read = json.loads(words)
    surface = MeshedSurface(**read.pop("surface")) if read["surface"] else read.pop("surface")
    return Tetrahedra(mesh, surface=surface, **read | {"tried": tuple(read["tried"])})


def recall(surface: Surface, edge_length: float, time_limit: float) -> Tetrahedra | None:
    """The mesh of this surface and edge length (mm), where one was made on this machine that this
    time limit (s) would not better."""
    path = _path(surface, edge_length)
    try:
        with path.open("rb") as file, np.load(file) as data:
            made = made_as(TetMesh(data["nodes"], data["tets"]), str(data["told"]))
        os.utime(path)
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile):
        return None  # none, or not readable: it is made anew
    return None if made.is_outgrown(time_limit) else made


def remember(surface: Surface, edge_length: float, made: Tetrahedra) -> None:
    """Keep the mesh. A cache that cannot be written must not stop a build."""
    path = _path(surface, edge_length)
    with contextlib.suppress(OSError, StorageError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as temporary:
            np.savez(temporary, nodes=made.mesh.nodes, tets=made.mesh.tets, told=told(made))
        meshes = sorted(path.parent.glob("*.npz"), key=lambda p: -p.stat().st_mtime)
        for old in meshes[KEPT:]:
            old.unlink(missing_ok=True)
