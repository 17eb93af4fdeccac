"""Writing parts: binary STL, and one 3MF with every part by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..core.mesh import Surface


def write_stl(surface: Surface, path: Path) -> None:
    """Binary STL in mm."""
    corners = surface.vertices[surface.faces].astype("<f4")
    record = np.zeros(
        len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("tag", "<u2")]
    )
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    record["normal"] = normal / np.where(length > 0, length, 1)
    record["corners"] = corners
    head = b"defsense-fab, millimetres".ljust(80, b" ")
    path.write_bytes(head + np.uint32(len(corners)).tobytes() + record.tobytes())


def write_3mf(parts: Mapping[str, Surface], path: Path, title: str) -> None:
    """An assembly of named parts in mm (3MF core specification: object with components)."""
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    assembly = model.AddComponentsObject()
    assembly.SetName(title)
    for name, surface in parts.items():
        mesh = model.AddMeshObject()
        mesh.SetName(name)
        vertices = [_position(lib3mf, v) for v in surface.vertices.tolist()]
        triangles = [_triangle(lib3mf, f) for f in surface.faces.tolist()]
        mesh.SetGeometry(vertices, triangles)
        assembly.AddComponent(mesh, wrapper.GetIdentityTransform())
    model.AddBuildItem(assembly, wrapper.GetIdentityTransform())
    model.QueryWriter("3mf").WriteToFile(str(path))


def _position(lib3mf, point):  # type: ignore[no-untyped-def]
    out = lib3mf.Position()
    for i in range(3):
        out.Coordinates[i] = point[i]
    return out


def _triangle(lib3mf, corners):  # type: ignore[no-untyped-def]
    out = lib3mf.Triangle()
    for i in range(3):
        out.Indices[i] = corners[i]
    return out
