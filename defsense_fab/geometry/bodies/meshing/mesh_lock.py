"""Store meshes that cannot be reproduced in `device.mesh`, next to `device.toml`.

The file belongs to the device like a lock file: with it, everyone who builds the device gets the
same mesh, and so the same cords and parts.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from ....core.errors import StorageError
from ....core.mesh import Surface, TetMesh
from ....core.storage.files import digest, replace_file, storage_errors
from .mesh_store import from_json, to_json
from .meshers import FTETWILD
from .tetrahedra import Tetrahedra

FILE = "device.mesh"


def mesh_key(surface: Surface, edge_length: float) -> str:
    """Return the key of a mesh, which does not depend on the mesher.

    Args:
        surface: Surface of the body.
        edge_length: Edge length in mm.
    """
    vertices = np.round(surface.vertices, 6) + 0.0  # no negative zeros
    return digest(float(edge_length), vertices.tobytes(), surface.faces.astype("<i8").tobytes())


def file_digest(device: Path) -> str | None:
    """Return the hash of the file in a device folder, or None if there is none."""
    path = device / FILE
    return digest(path) if path.exists() else None


def has_outgrown_mesh(device: Path, time_limit: float) -> bool:
    """Return whether a longer time limit would improve a stored mesh.

    Args:
        device: Device folder.
        time_limit: Time limit of meshing in s.

    Returns:
        False also for an unreadable file, which is reported when the meshes are used.
    """
    with suppress(StorageError):
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
    path = device / FILE
    try:
        with path.open("rb") as file, np.load(file) as data:
            keys = sorted({name.rpartition("/")[0] for name in data.files})
            return {key: _read_mesh(data, key) for key in keys}
    except FileNotFoundError:
        return {}
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile) as error:
        raise StorageError(
            f"cannot be read as meshes ({error})",
            code="file-damaged",
            where=path,
            action="Restore it, or delete it to mesh the body again",
            path=path,
        ) from None


def _read_mesh(data: Mapping[str, np.ndarray], key: str) -> Tetrahedra:
    mesh = TetMesh(data[f"{key}/nodes"], data[f"{key}/tets"].astype(np.int64))
    if f"{key}/told" in data:
        return from_json(mesh, str(data[f"{key}/told"]))
    return Tetrahedra(mesh, FTETWILD)  # older files contain only meshes of fTetWild


def write_meshes(device: Path, meshes: Mapping[str, Tetrahedra]) -> None:
    """Replace the stored meshes of a device folder.

    Args:
        device: Device folder.
        meshes: Meshes by key; without meshes, the file is deleted.

    Raises:
        StorageError: The file cannot be written.
    """
    if not meshes:
        with storage_errors(device / FILE):
            (device / FILE).unlink(missing_ok=True)
        return
    arrays = {}
    for key, tetrahedra in sorted(meshes.items()):
        arrays[f"{key}/nodes"] = tetrahedra.mesh.nodes
        arrays[f"{key}/tets"] = tetrahedra.mesh.tets.astype(np.int32)
        arrays[f"{key}/told"] = np.array(to_json(tetrahedra))
    with replace_file(device / FILE) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
