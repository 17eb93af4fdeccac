"""Finished parts, read back from their files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from ...core.errors import StorageError
from ...core.mesh import Surface
from ...core.device.build_folder import BUILD_AGAIN
from .manifest import FOLDER, Manifest


def load_part(path: Path) -> Surface:
    """The surface of an STL."""
    mesh = trimesh.load_mesh(path)
    return Surface(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))


def load_parts(folder: Path, manifest: Manifest) -> dict[str, Surface]:
    """The parts of a build's `folder` by name, where they belong in the device. Raises
    StorageError."""
    out = {}
    for part in manifest.parts:
        path = folder / FOLDER / part.stl
        try:
            out[part.name] = load_part(path)
        except (OSError, ValueError) as error:
            raise StorageError(f"{path}: cannot be read: {error}; {BUILD_AGAIN}") from None
    return out
