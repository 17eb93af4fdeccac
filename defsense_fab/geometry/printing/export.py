"""Write parts as binary STL files, or as one 3MF file with every part by name.

Programs that read these files find the edges of a surface by the places of its corners. A file
therefore keeps corners apart that are apart in the surface: a closed surface is closed in the file.
Facets that are lines in the file's coordinates are replaced where the surface stays closed.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from .slivers import replace_lines

#: Decimals of coordinates that lib3mf writes; it cuts the rest off.
_DECIMALS_3MF = 6


def write_stl(surface: Surface, path: Path) -> None:
    """Write a surface as binary STL, in mm.

    Raises:
        FabricationError: Corners that are apart in the surface cannot be kept apart.
    """
    vertices = _keep_corners_apart(
        surface.vertices, triangle_kernel.round_to_single, 0.0, path.stem
    )
    faces = replace_lines(Surface(triangle_kernel.round_to_single(vertices), surface.faces))
    corners = vertices[faces].astype("<f4")
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

    Raises:
        FabricationError: Corners that are apart in a surface cannot be kept apart.
    """
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    model.SetBuildUUID(make_uuid(title, "build"))
    if together:
        assembly = model.AddComponentsObject()
        assembly.SetName(title)
        assembly.SetUUID(make_uuid(title, "assembly"))
    for name, surface in parts.items():
        mesh = model.AddMeshObject()
        mesh.SetName(name)
        mesh.SetUUID(make_uuid(title, "object", name))
        fill_mesh(mesh, surface, name)
        if together:
            component = assembly.AddComponent(mesh, wrapper.GetIdentityTransform())
            component.SetUUID(make_uuid(title, "component", name))
        else:
            item = model.AddBuildItem(mesh, wrapper.GetIdentityTransform())
            item.SetUUID(make_uuid(title, "item", name))
    if together:
        item = model.AddBuildItem(assembly, wrapper.GetIdentityTransform())
        item.SetUUID(make_uuid(title, "item"))
    # Write to memory first: on a full disk lib3mf ends the program.
    path.write_bytes(bytes(model.QueryWriter("3mf").WriteToBuffer()))


def prepare_3mf_mesh(surface: Surface, name: str) -> Surface:
    """Return a surface for a 3MF file, whose corners stay apart when the file rounds them.

    Args:
        surface: Closed surface, mm.
        name: Name of the part for errors.

    Raises:
        FabricationError: Corners that are apart in the surface cannot be kept apart.
    """
    corners = _keep_corners_apart(surface.vertices, _round_as_3mf, 10.0**-_DECIMALS_3MF, name)
    faces = replace_lines(Surface(_round_as_3mf(corners), surface.faces))
    return Surface(corners, faces)


def fill_mesh(mesh: Any, surface: Surface, name: str) -> None:
    """Set the geometry of a lib3mf mesh object, in mm.

    Args:
        mesh: Mesh object of lib3mf.
        surface: Closed surface, mm.
        name: Name of the part for errors.

    Raises:
        FabricationError: Corners that are apart in the surface cannot be kept apart.
    """
    import lib3mf

    ready = prepare_3mf_mesh(surface, name)
    vertices = [_fill(lib3mf.Position(), "Coordinates", v) for v in ready.vertices.tolist()]
    triangles = [_fill(lib3mf.Triangle(), "Indices", f) for f in ready.faces.tolist()]
    mesh.SetGeometry(vertices, triangles)


def _keep_corners_apart(
    vertices: Float, rounded: Callable[[Float], Float], resolution: float, what: str
) -> Float:
    """Return corners (n, 3) for a file that rounds them.

    They are unchanged if rounding keeps all of them apart that are apart; otherwise some of them
    are moved by less than a thousandth of a mm.

    Args:
        vertices: Corners (n, 3), mm.
        rounded: Function that rounds coordinates as the file does.
        resolution: Least difference of coordinates in the file near the origin, mm.
        what: Name of the part for errors.
    """
    if not len(vertices):
        return vertices
    places, place_of_corner = np.unique(vertices, axis=0, return_inverse=True)
    if len(np.unique(rounded(places), axis=0)) == len(places):
        return vertices
    rounding = max(float(np.spacing(np.float32(np.abs(places).max()))), resolution)
    step = triangle_kernel.ROUNDINGS_MOVED * rounding
    separated = triangle_kernel.separate_corners(places, rounded, step, what)
    return np.asarray(separated[place_of_corner.reshape(-1)])


def _round_as_3mf(vertices: Float) -> Float:
    """Return coordinates as a program reads them from a 3MF file.

    lib3mf multiplies in single precision, cuts the decimals off, and programs read single
    precision.
    """
    scaled = vertices.astype(np.float32) * np.float32(10**_DECIMALS_3MF)
    return triangle_kernel.round_to_single(np.trunc(scaled.astype(float)) / 10**_DECIMALS_3MF)


def make_uuid(*names: str) -> str:
    """Return a UUID derived from names, so that the same parts give the same bytes."""
    return str(uuid.uuid5(uuid.NAMESPACE_OID, "\0".join(("defsense-fab", *names))))


def _fill(record: Any, field: str, values: Sequence[float]) -> Any:
    for i, value in enumerate(values):
        getattr(record, field)[i] = value
    return record
