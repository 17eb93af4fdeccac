"""`device.mesh`: meshes that no mesher would give again, kept beside `device.toml`.

It belongs to the device as a lock file does: with it, whoever builds the device has the same mesh,
and so the same cords and parts.
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
from .mesh_store import made_as, told
from .meshers import FTETWILD
from .tetrahedra import Tetrahedra

FILE = "device.mesh"


def key(surface: Surface, edge_length: float) -> str:
    """What a mesh of this surface and edge length (mm) is called, whatever made it."""
    vertices = np.round(surface.vertices, 6) + 0.0  # no negative zeros
    return digest(float(edge_length), vertices.tobytes(), surface.faces.astype("<i8").tobytes())


def content(device: Path) -> str | None:
    """Hash of the file of a device's folder; None where there is none."""
    path = device / FILE
    return digest(path) if path.exists() else None


def outgrown(device: Path, time_limit: float) -> bool:
    """Whether this time limit (s) would better a mesh that is kept; not of a file that cannot be
    read, which is told when it is used."""
    with suppress(StorageError):
        return any(made.is_outgrown(time_limit) for made in read(device).values())
    return False


def read(device: Path) -> dict[str, Tetrahedra]:
    """The meshes by key, with what made them; none where the folder has no such file. Raises
    StorageError."""
    path = device / FILE
    try:
        with path.open("rb") as file, np.load(file) as data:
            names = sorted({name.rpartition("/")[0] for name in data.files})
            out = {}
            for name in names:
                mesh = TetMesh(data[f"{name}/nodes"], data[f"{name}/tets"].astype(np.int64))
                known = f"{name}/told" in data.files  # of files from before, fTetWild's all
                out[name] = (
                    made_as(mesh, str(data[f"{name}/told"]))
                    if known
                    else Tetrahedra(mesh, FTETWILD)
                )
            return out
    except FileNotFoundError:
        return {}
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile) as error:
        raise StorageError(
            f"{path}: cannot be read as meshes ({error}); restore it, or delete it to have the body"
            " meshed anew"
        ) from None


def write(device: Path, meshes: Mapping[str, Tetrahedra]) -> None:
    """Keep these meshes and no others; no file where there are none. Raises StorageError."""
    if not meshes:
        with storage_errors(device / FILE):
            (device / FILE).unlink(missing_ok=True)
        return
    arrays = {}
    for name, made in sorted(meshes.items()):
        arrays[f"{name}/nodes"] = made.mesh.nodes
        arrays[f"{name}/tets"] = made.mesh.tets.astype(np.int32)
        arrays[f"{name}/told"] = np.array(told(made))
    with replace_file(device / FILE) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
