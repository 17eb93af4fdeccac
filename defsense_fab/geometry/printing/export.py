"""Write parts as binary STL files, or as one 3MF file with every part by name."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core.mesh import Surface


def write_stl(surface: Surface, path: Path) -> None:
    """Write a surface as binary STL, in mm."""
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


def write_3mf(parts: Mapping[str, Surface], path: Path, title: str, together: bool = True) -> None:
    """Write named parts as 3MF, in mm.

    Args:
        parts: Surfaces by name.
        path: The file.
        title: Name of the assembly.
        together: Whether to write one assembly (3MF core specification: object with components);
            otherwise each part is an item that a slicer can move.
    """
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    model.SetBuildUUID(_make_uuid(title, "build"))
    if together:
        assembly = model.AddComponentsObject()
        assembly.SetName(title)
        assembly.SetUUID(_make_uuid(title, "assembly"))
    for name, surface in parts.items():
        mesh = model.AddMeshObject()
        mesh.SetName(name)
        mesh.SetUUID(_make_uuid(title, "object", name))
        vertices = [_fill(lib3mf.Position(), "Coordinates", v) for v in surface.vertices.tolist()]
        triangles = [_fill(lib3mf.Triangle(), "Indices", f) for f in surface.faces.tolist()]
        mesh.SetGeometry(vertices, triangles)
        if together:
            component = assembly.AddComponent(mesh, wrapper.GetIdentityTransform())
            component.SetUUID(_make_uuid(title, "component", name))
        else:
            item = model.AddBuildItem(mesh, wrapper.GetIdentityTransform())
            item.SetUUID(_make_uuid(title, "item", name))
    if together:
        item = model.AddBuildItem(assembly, wrapper.GetIdentityTransform())
        item.SetUUID(_make_uuid(title, "item"))
    # Write to memory first: on a full disk lib3mf ends the program.
    path.write_bytes(bytes(model.QueryWriter("3mf").WriteToBuffer()))


def _make_uuid(*names: str) -> str:
    """Return a UUID derived from names: lib3mf draws at random, and the same parts must give the
    same bytes.
    """
    return str(uuid.uuid5(uuid.NAMESPACE_OID, "\0".join(("defsense-fab", *names))))


def _fill(record: Any, field: str, values: Sequence[float]) -> Any:
    for i, value in enumerate(values):
        getattr(record, field)[i] = value
    return record
