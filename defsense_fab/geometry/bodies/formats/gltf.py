"""Read glTF files: GLB, or .gltf that holds its data itself."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from ....core.errors import BodyError
from .triangles import Triangles


class _NoFiles:
    """Refuse access to the files that a glTF file names."""

    def get(self, name: str) -> bytes:
        raise BodyError(
            f"it names another file, {name[:80]!r}, which is not read",
            code="names-another-file",
            action="Export GLB, which holds everything",
            name=name,
        )

    __getitem__ = get


def read_gltf(path: Path, suffix: str) -> Triangles:
    """Read the triangles of a scene, mm with z up. Other files that it names are not read.

    Args:
        path: The file.
        suffix: Suffix of its format: .glb or .gltf.

    Raises:
        BodyError: If it names another file. Damaged files raise whatever the reader does.
    """
    import trimesh

    content = path.read_bytes()
    nowhere: Any = _NoFiles()
    scene: Any = trimesh.load_scene(
        io.BytesIO(content), file_type=suffix[1:], skip_materials=True, resolver=nowhere
    )
    mesh = scene.to_mesh()
    x, y, z = np.asarray(mesh.vertices, float).T
    notes = ("converted metres with y up, as in GLB, to millimetres with z up",)
    vertices = 1e3 * np.stack([x, -z, y], axis=1)
    return Triangles(vertices, np.asarray(mesh.faces, np.int64), notes, 1e3)
