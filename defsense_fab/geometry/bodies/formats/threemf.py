"""Read 3MF files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .triangles import Triangles

_3MF_UNITS = {
    "MicroMeter": 1e-3,
    "MilliMeter": 1.0,
    "CentiMeter": 10.0,
    "Inch": 25.4,
    "Foot": 304.8,
    "Meter": 1e3,
}


def read_3mf(path: Path) -> Triangles:
    """Read the triangles of all build items, mm.

    Args:
        path: The file.

    Raises:
        Exception: Damaged files raise whatever the reader does.
    """
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(path))
    unit = _3MF_UNITS[model.GetUnit().name]
    merged = model.MergeToModel()  # build items with their components and transforms
    objects = merged.GetMeshObjects()
    vertices, faces, offset = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    while objects.MoveNext():
        mesh = objects.GetCurrentMeshObject()
        v = np.array([list(p.Coordinates) for p in mesh.GetVertices()], float).reshape(-1, 3)
        f = np.array([list(t.Indices) for t in mesh.GetTriangleIndices()], np.int64).reshape(-1, 3)
        vertices.append(v)
        faces.append(f + offset)
        offset += len(v)
    return Triangles(unit * np.concatenate(vertices), np.concatenate(faces), unit=unit)
