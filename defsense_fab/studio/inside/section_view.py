"""Draw a section in the scene: its colors, the half of the body behind it, cords and marks."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...runtime.view.cord_mesh import tube_faces, tube_vertices

_BODY_COLOR, _CORD_COLOR = (150, 180, 205), (70, 70, 75)
_NEW_CORD_COLOR, _MARK_COLOR = (230, 97, 1), (20, 20, 20)
_POINTS_PER_TUBE = 80
_DOT_SIZE = 1.1  # times the distance of the dots

# ACES tone mapping of three.js (ACESFilmicToneMapping): matrices into and out of its color space,
# and the curve y = (x^2 + p x - q) / (r x^2 + s x + t) between them.
_ACES_INPUT = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_ACES_OUTPUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
_ACES_P, _ACES_Q = 0.0245786, 0.000090537
_ACES_R, _ACES_S, _ACES_T = 0.983729, 0.4329510, 0.238081
_ACES_EXPOSURE = 0.6
_MAX_TONE_MAPPED = 0.985  # the curve is nearly level above and cannot be inverted

_GLTF_FLOAT, _GLTF_UINT = 5126, 5125  # component types

#: Called with the origin (3,) mm and direction (3,) of the ray of a click.
RayCallback = Callable[[Float, Float], None]


class SectionView:
    """Objects of a section in a viser server's scene.

    Call the methods while the workbench's `drawing_lock` is held.

    Args:
        server: The viser server.
        size: Size of the body, mm.
        on_click: Called with the ray of each click in the scene.

    Attributes:
        shell: Vertices (v, 3) mm of the part of the body that is drawn; empty for none.
    """

    def __init__(self, server: Any, size: float, on_click: RayCallback) -> None:
        self._scene, self._size, self._on_click = server.scene, size, on_click
        # Clicks on the scene, because a clickable mesh gets an outline under the pointer.
        self._listener = self._scene.on_click()(self._report_click)
        self._parts: dict[str, Any] = {}
        self._meshes: list[Any] = []  # the newest is last
        self._mesh_count = 0
        self.shell: Float = np.zeros((0, 3))

    def show_coarse(self, points: Float, colors: Float, step: float) -> None:
        """Draw dots in place of the section, which is quick enough to follow a drag.

        Args:
            points: (p, 3) mm.
            colors: (p, 3), 0 to 1.
            step: Distance of the dots, mm.
        """
        if "coarse" not in self._parts:
            self._parts["coarse"] = self._scene.add_point_cloud(
                "/inside/coarse",
                points.astype(np.float32),
                _to_bytes(colors),
                point_size=_DOT_SIZE * step,
                point_shape="square",
                precision="float32",
                point_shading="flat",
            )
        dots = self._parts["coarse"]
        dots.points, dots.colors = points.astype(np.float32), _to_bytes(colors)
        dots.point_size, dots.visible = _DOT_SIZE * step, True
        for mesh in self._meshes:
            mesh.visible = False

    def show_fine(self, points: Float, triangles: Int, colors: Float) -> None:
        """Draw the section; the previous one stays until `remove_previous`.

        Browsers need some time to read the new one.

        Args:
            points: (v, 3) mm, vertices.
            triangles: (t, 3) indices of vertices.
            colors: (v, 3), 0 to 1.
        """
        self._mesh_count += 1
        mesh = self._scene.add_glb(
            f"/inside/cut/{self._mesh_count}",
            unlit_mesh(points, triangles, colors),
            cast_shadow=False,
            receive_shadow=False,
        )
        self._meshes.append(mesh)

    def remove_previous(self) -> None:
        """Remove the sections before the newest one, and the dots."""
        for mesh in self._meshes[:-1]:
            mesh.remove()
        self._meshes = self._meshes[-1:]
        if "coarse" in self._parts:
            self._parts["coarse"].visible = False

    def show_shell(self, vertices: Float, faces: Int) -> None:
        """Draw a part of the body: vertices (v, 3) mm and faces (f, 3)."""
        self._remove("shell")
        self.shell = vertices if len(faces) else np.zeros((0, 3))
        if len(faces):
            self._parts["shell"] = self._scene.add_mesh_simple(
                "/inside/shell",
                vertices.astype(np.float32),
                faces.astype(np.uint32),
                color=_BODY_COLOR,
                opacity=0.35,
                side="double",
                cast_shadow=False,
            )

    def show_cords(self, paths: Sequence[Float], radius: float) -> None:
        """Draw cords along paths (p, 3) mm each."""
        self._remove("cord")
        for k, path in enumerate(paths):
            self._parts[f"cord {k}"] = self._tube(f"/inside/cord/{k}", path, radius, _CORD_COLOR)

    def show_new_cord(self, path: Float | None, radius: float) -> None:
        """Draw the best additional cord along a path (p, 3) mm, or none."""
        self._remove("new")
        if path is not None:
            self._parts["new"] = self._tube("/inside/new", path, radius, _NEW_CORD_COLOR)

    def show_direction(self, path: Float | None) -> None:
        """Draw the direction of the stretch as a line (p, 3) mm, or none."""
        self._remove("direction")
        if path is not None:
            self._parts["direction"] = self._scene.add_line_segments(
                "/inside/direction",
                np.stack([path[:-1], path[1:]], axis=1).astype(np.float32),
                _MARK_COLOR,
                thickness=3.0,
                thickness_units="screen",
            )

    def mark(self, point: Float | None) -> None:
        """Mark a point (3,) mm with a dot, or remove the dot."""
        self._remove("mark")
        if point is not None:
            self._parts["mark"] = self._scene.add_icosphere(
                "/inside/mark",
                0.008 * self._size,
                color=_MARK_COLOR,
                position=tuple(point.tolist()),
            )

    def close(self) -> None:
        """Remove all objects and stop listening to clicks."""
        self.clear()
        self._scene.remove_click_callback(self._listener)

    def clear(self) -> None:
        """Remove all objects."""
        for part in (*self._parts.values(), *self._meshes):
            part.remove()
        self._parts, self._meshes, self.shell = {}, [], np.zeros((0, 3))

    def _report_click(self, event: Any) -> None:
        self._on_click(np.array(event.ray_origin, float), np.array(event.ray_direction, float))

    def _tube(self, name: str, path: Float, radius: float, color: tuple[int, int, int]) -> Any:
        count = min(_POINTS_PER_TUBE, len(path))
        indices = np.linspace(0, len(path) - 1, count).round().astype(int)
        vertices = tube_vertices(path[indices], radius).astype(np.float32)
        faces = tube_faces(len(indices)).astype(np.uint32)
        return self._scene.add_mesh_simple(name, vertices, faces, color=color, cast_shadow=False)

    def _remove(self, kind: str) -> None:
        for name in [n for n in self._parts if n.split()[0] == kind]:
            self._parts.pop(name).remove()


def hit_triangle(
    origin: Float, direction: Float, points: Float, triangles: Int
) -> tuple[int, Float] | None:
    """Find the first triangle that a ray meets.

    Args:
        origin: Origin of the ray (3,) mm.
        direction: Its direction (3,).
        points: (v, 3) mm, vertices.
        triangles: (t, 3) indices of vertices.

    Returns:
        The index of the triangle and the weights (3,) of its corners at the hit; None if the ray
        meets no triangle.

    References:
        Möller & Trumbore (1997), Fast, minimum storage ray/triangle intersection.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    ab, ac, to_origin = b - a, c - a, origin - a
    p = np.cross(direction, ac)
    volume = np.einsum("tj,tj->t", ab, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("tj,tj->t", to_origin, p) / volume
        q = np.cross(to_origin, ab)
        v = q @ direction / volume
        distance = np.einsum("tj,tj->t", ac, q) / volume
        is_hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (distance > 0)
    if not is_hit.any():
        return None
    t = int(np.where(is_hit, distance, np.inf).argmin())
    return t, np.array([1 - u[t] - v[t], u[t], v[t]])


def unlit_mesh(vertices: Float, triangles: Int, colors: Float) -> bytes:
    """Return a mesh as GLB whose colors on the screen are exact to some hundredths.

    The page lights its meshes and applies the ACES tone mapping of three.js. This mesh has a glTF
    material without light, and its colors are passed through the inverse of the tone mapping.

    Args:
        vertices: (v, 3) mm.
        triangles: (t, 3) indices of vertices; visible from both sides.
        colors: (v, 3) sRGB colors on the screen, 0 to 1.
    """
    parts = [
        np.asarray(vertices, "<f4"),
        np.asarray(_invert_tone_mapping(colors), "<f4"),
        np.asarray(triangles, "<u4").ravel(),
    ]
    chunks = [part.tobytes() for part in parts]
    starts = np.cumsum([0, *map(len, chunks)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": len(chunk)}
        for start, chunk in zip(starts, chunks, strict=False)
    ]
    accessors: list[dict[str, Any]] = [
        {"bufferView": k, "componentType": _GLTF_FLOAT, "count": len(parts[k]), "type": "VEC3"}
        for k in range(2)
    ]
    accessors[0] |= {"min": parts[0].min(axis=0).tolist(), "max": parts[0].max(axis=0).tolist()}
    accessors.append(
        {"bufferView": 2, "componentType": _GLTF_UINT, "count": len(parts[2]), "type": "SCALAR"}
    )
    attributes = {"POSITION": 0, "COLOR_0": 1}
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
        "materials": [{"doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}],
        "buffers": [{"byteLength": starts[-1]}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(chunks)
    size = 12 + 8 + len(text) + 8 + len(body)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, size),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", len(body), b"BIN\0"),
            body,
        ]
    )


def _invert_tone_mapping(colors: Float) -> Float:
    """Return the linear colors that three.js shows as the sRGB colors (v, 3)."""
    linear = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    y = np.clip(np.linalg.solve(_ACES_OUTPUT, linear.T).T, 0.0, _MAX_TONE_MAPPED)
    a, b, c = 1 - _ACES_R * y, _ACES_P - _ACES_S * y, -_ACES_Q - _ACES_T * y
    x = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    return np.asarray(np.maximum(np.linalg.solve(_ACES_INPUT, x.T).T, 0.0) * _ACES_EXPOSURE)


def _to_bytes(colors: Float) -> Any:
    return np.rint(255 * colors).astype(np.uint8)
