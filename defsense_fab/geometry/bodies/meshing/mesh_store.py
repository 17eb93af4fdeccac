"""Store meshes by body and edge length, since meshing takes seconds to minutes.

The cache of this machine holds every mesh. Meshes that cannot be reproduced are also stored in
`device.mesh`, next to `device.toml`: it belongs to the device like a lock file, so that everyone
who builds the device gets the same mesh, and so the same cords and parts.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, fields
from importlib.metadata import version
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from platformdirs import user_cache_path

from ....core.errors import StorageError
from ....core.mesh import Surface, TetMesh
from ....core.storage.files import DIGEST_PATTERN, digest, replace_file, storage_errors
from .tetrahedra import MeshedSurface, Tetrahedra

#: Name of the file in a device's folder.
DEVICE_MESH = "device.mesh"
#: Increase this to mesh all bodies again.
CACHE_VERSION = 7
#: Number of meshes in the cache; the oldest are deleted.
MAX_MESHES = 100

_DAMAGED = (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile)


def mesh_key(surface: Surface, edge_length: float) -> str:
    """Return the key of a mesh, which does not depend on the mesher.

    Args:
        surface: Surface of the body.
        edge_length: Edge length in mm.
    """
    vertices = np.round(surface.vertices, 6) + 0.0  # no negative zeros
    return digest(float(edge_length), vertices.tobytes(), surface.faces.astype("<i8").tobytes())


def _to_arrays(tetrahedra: Tetrahedra) -> dict[str, np.ndarray]:
    """Return the nodes, the tets, and all other fields as JSON."""
    data = {f.name: getattr(tetrahedra, f.name) for f in fields(tetrahedra) if f.name != "mesh"}
    surface = asdict(tetrahedra.surface) if tetrahedra.surface else None
    record = json.dumps(data | {"surface": surface})
    mesh = tetrahedra.mesh
    return {"nodes": mesh.nodes, "tets": mesh.tets.astype(np.int32), "record": np.array(record)}


def _from_arrays(arrays: Mapping[str, np.ndarray], prefix: str = "") -> Tetrahedra:
    """Return the tetrahedra of `_to_arrays`, whose names have a prefix."""
    nodes, tets, record = (arrays[prefix + name] for name in ("nodes", "tets", "record"))
    data = json.loads(str(record))
    surface = data["surface"] and MeshedSurface(**data["surface"])
    changed = {"surface": surface, "tried": tuple(data["tried"])}
    return Tetrahedra(TetMesh(nodes, tets.astype(np.int64)), **data | changed)


def cache_folder() -> Path:
    """Return `DEFSENSE_CACHE`, or else the user's cache folder."""
    folder = os.environ.get("DEFSENSE_CACHE")
    return Path(folder) if folder else user_cache_path("defsense-fab") / "meshes"


def cached_meshes() -> list[Path]:
    """Return the files of the meshes in the cache of this machine."""
    return list(cache_folder().glob(f"{DIGEST_PATTERN}.npz"))


def _cached_file(surface: Surface, edge_length: float) -> Path:
    meshers = version("netgen-mesher"), version("pytetwild")
    return cache_folder() / f"{digest(CACHE_VERSION, meshers, mesh_key(surface, edge_length))}.npz"


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
    path = _cached_file(surface, edge_length)
    try:
        with path.open("rb") as file, np.load(file) as data:
            tetrahedra = _from_arrays(data)
        os.utime(path)
    except _DAMAGED:
        return None
    return None if tetrahedra.is_outgrown(time_limit) else tetrahedra


def cache_mesh(surface: Surface, edge_length: float, tetrahedra: Tetrahedra) -> None:
    """Store a mesh in the cache, if possible: an unwritable cache must not stop a build.

    Args:
        surface: Surface of the body.
        edge_length: Edge length in mm.
        tetrahedra: Mesh of the surface.
    """
    path = _cached_file(surface, edge_length)
    with contextlib.suppress(OSError, StorageError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as temporary:
            np.savez(temporary, **_to_arrays(tetrahedra))  # type: ignore[arg-type]
        meshes = sorted(cached_meshes(), key=lambda p: -p.stat().st_mtime)
        for old in meshes[MAX_MESHES:]:
            old.unlink(missing_ok=True)


def file_digest(device: Path) -> str | None:
    """Return the hash of `device.mesh` in a device folder, or None if there is none."""
    path = device / DEVICE_MESH
    return digest(path) if path.exists() else None


def has_outgrown_mesh(device: Path, time_limit: float) -> bool:
    """Return whether a longer time limit would improve a mesh of a device folder.

    Args:
        device: Device folder.
        time_limit: Time limit of meshing in s.

    Returns:
        False also for an unreadable file, which is reported when the meshes are used.
    """
    with contextlib.suppress(StorageError):
        return any(mesh.is_outgrown(time_limit) for mesh in read_meshes(device).values())
    return False


def read_meshes(device: Path) -> dict[str, Tetrahedra]:
    """Read the meshes of a device folder.

    Args:
        device: Device folder.

    Returns:
        Meshes by key, with their meshers; empty if the folder has no such file.

    Raises:
        StorageError: The file is damaged or cannot be read (`file-damaged`).
    """
    path = device / DEVICE_MESH
    try:
        with path.open("rb") as file, np.load(file) as data:
            keys = sorted({name.rpartition("/")[0] for name in data.files})
            return {key: _from_arrays(data, f"{key}/") for key in keys}
    except FileNotFoundError:
        return {}
    except _DAMAGED as error:
        raise StorageError(
            f"cannot be read as meshes ({error})",
            code="file-damaged",
            where=path,
            action="Restore it, or delete it to mesh the body again",
            path=path,
        ) from None


def write_meshes(device: Path, meshes: Mapping[str, Tetrahedra]) -> None:
    """Replace the stored meshes of a device folder.

    Args:
        device: Device folder.
        meshes: Meshes by key; without meshes, the file is deleted.

    Raises:
        StorageError: The file cannot be written.
    """
    path = device / DEVICE_MESH
    if not meshes:
        with storage_errors(path):
            path.unlink(missing_ok=True)
        return
    arrays = {
        f"{key}/{name}": array
        for key, tetrahedra in sorted(meshes.items())
        for name, array in _to_arrays(tetrahedra).items()
    }
    with replace_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
