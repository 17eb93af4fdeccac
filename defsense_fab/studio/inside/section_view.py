"""A section in three dimensions: its colours, the half of the body behind it, cords, marks."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...runtime.view.cord_mesh import tube_faces, tube_vertices

# A mesh whose colours are those of its numbers: no lamp shines on it.
#
# What the page draws is lit, and goes through a curve that a film would have (ACES, as three.js has
# it). A glTF material without light, with colours that the curve maps to those wanted, is exact to
# some hundredths.

#: Of three.js' ACESFilmicToneMapping: into and out of its space, the curve between.
_INTO = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_OUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
_P, _Q, _R, _S, _T = 0.0245786, 0.000090537, 0.983729, 0.4329510, 0.238081
_EXPOSURE = 0.6
_MOST = 0.985  # where the curve is nearly level, no input is asked for
_FLOAT, _WHOLE = 5126, 5125  # glTF's numbers for types


def unlit_mesh(vertices: Float, triangles: Int, colors: Float) -> bytes:
    """GLB of vertices (v, 3), triangles (t, 3) seen from both sides, and their colours (v, 3) from
    0 to 1 as a screen shows them."""
    parts = [
        np.asarray(vertices, "<f4"),
        np.asarray(_before_the_curve(colors), "<f4"),
        np.asarray(triangles, "<u4").ravel(),
    ]
    chunks = [part.tobytes() for part in parts]
    starts = np.cumsum([0, *map(len, chunks)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": at, "byteLength": len(c)}
        for at, c in zip(starts, chunks, strict=False)
    ]
    accessors: list[dict[str, Any]] = [
        {"bufferView": k, "componentType": _FLOAT, "count": len(parts[k]), "type": "VEC3"}
        for k in range(2)
    ]
    accessors[0] |= {"min": parts[0].min(axis=0).tolist(), "max": parts[0].max(axis=0).tolist()}
    accessors.append(
        {"bufferView": 2, "componentType": _WHOLE, "count": len(parts[2]), "type": "SCALAR"}
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
    whole = 12 + 8 + len(text) + 8 + len(body)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, whole),
            struct.pack("<I4s", len(text), b"JSON"), text,
            struct.pack("<I4s", len(body), b"BIN\0"), body,
        ]
    )  # fmt: skip


def _before_the_curve(colors: Float) -> Float:
    """What three.js has to be given that it shows the colours (v, 3)."""
    linear = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    y = np.clip(np.linalg.solve(_OUT, linear.T).T, 0.0, _MOST)
    # y = (x^2 + p x - q) / (r x^2 + s x + t)
    a, b, c = 1 - _R * y, _P - _S * y, -_Q - _T * y
    x = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    return np.asarray(np.maximum(np.linalg.solve(_INTO, x.T).T, 0.0) * _EXPOSURE)


_BODY, _CORD, _NEW, _MARK = (150, 180, 205), (70, 70, 75), (230, 97, 1), (20, 20, 20)
_SAMPLES = 80  # points of a tube
#: Called with a ray's origin (3,) and direction (3,), mm.
Clicked = Callable[[Float, Float], None]


class SectionView:
    """What a section consists of in a viser server's scene. Its methods are called with the page's
    lock taken."""

    def __init__(self, server: Any, size: float, clicked: Clicked) -> None:
        """Of a body of a `size` mm."""
        self._scene, self._size, self._clicked = server.scene, size, clicked
        # A mesh that is clickable itself gets an outline as the pointer passes over it.
        self._listens = self._scene.on_click()(self._hit)
        self._parts: dict[str, Any] = {}
        self._meshes: list[Any] = []  # the newest last
        self._made = 0

    def show_coarse(self, points: Float, colors: Float, step: float) -> None:
        """Dots at points (p, 3), `step` mm apart, that follow a hand."""
        if "coarse" not in self._parts:
            self._parts["coarse"] = self._scene.add_point_cloud(
                "/inside/coarse", points.astype(np.float32), _bytes(colors), point_size=1.1 * step,
                point_shape="square", precision="float32", point_shading="flat",
            )  # fmt: skip
        dots = self._parts["coarse"]
        dots.points, dots.colors = points.astype(np.float32), _bytes(colors)
        dots.point_size, dots.visible = 1.1 * step, True
        for mesh in self._meshes:
            mesh.visible = False

    def show_fine(self, points: Float, triangles: Int, colors: Float) -> None:
        """The cut itself, vertices (v, 3). What was there before stays until `settle`, while the
        browser reads the new one."""
        self._made += 1
        mesh = self._scene.add_glb(
            f"/inside/cut/{self._made}", unlit_mesh(points, triangles, colors), cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip
        self._meshes.append(mesh)

    def settle(self) -> None:
        """Take away what the newest cut replaces."""
        for old in self._meshes[:-1]:
            old.remove()
        self._meshes = self._meshes[-1:]
        if "coarse" in self._parts:
            self._parts["coarse"].visible = False

    def show_shell(self, vertices: Float, faces: Int) -> None:
        """The half of the body behind the plane, (v, 3) and (f, 3)."""
        self._drop("shell")
        if len(faces):
            self._parts["shell"] = self._scene.add_mesh_simple(
                "/inside/shell", vertices.astype(np.float32), faces.astype(np.uint32),
                color=_BODY, opacity=0.35, side="double", cast_shadow=False,
            )  # fmt: skip

    def show_cords(self, paths: Sequence[Float], radius: float) -> None:
        """Tubes along paths (p, 3) mm each."""
        self._drop("cord")
        for k, path in enumerate(paths):
            self._parts[f"cord {k}"] = self._tube(f"/inside/cord/{k}", path, radius, _CORD)

    def show_new(self, path: Float | None, radius: float) -> None:
        """The cord that would help most, or none."""
        self._drop("new")
        if path is not None:
            self._parts["new"] = self._tube("/inside/new", path, radius, _NEW)

    def show_direction(self, path: Float | None) -> None:
        """A line along which stretch is told, or none."""
        self._drop("direction")
        if path is not None:
            self._parts["direction"] = self._scene.add_line_segments(
                "/inside/direction", np.stack([path[:-1], path[1:]], axis=1).astype(np.float32),
                _MARK, thickness=3.0, thickness_units="screen",
            )  # fmt: skip

    def mark(self, point: Float | None) -> None:
        """A dot at a point (3,), or none."""
        self._drop("mark")
        if point is not None:
            self._parts["mark"] = self._scene.add_icosphere(
                "/inside/mark", 0.008 * self._size, color=_MARK, position=tuple(point.tolist())
            )

    def close(self) -> None:
        """Take everything away, and hear of clicks no more."""
        self.clear()
        self._scene.remove_click_callback(self._listens)

    def clear(self) -> None:
        """Take everything away."""
        for part in (*self._parts.values(), *self._meshes):
            part.remove()
        self._parts, self._meshes = {}, []

    def _hit(self, event: Any) -> None:
        self._clicked(np.array(event.ray_origin, float), np.array(event.ray_direction, float))

    def _tube(self, name: str, path: Float, radius: float, color: tuple[int, int, int]) -> Any:
        some = np.linspace(0, len(path) - 1, min(_SAMPLES, len(path))).round().astype(int)
        vertices = tube_vertices(path[some], radius).astype(np.float32)
        faces = tube_faces(len(some)).astype(np.uint32)
        return self._scene.add_mesh_simple(name, vertices, faces, color=color, cast_shadow=False)

    def _drop(self, kind: str) -> None:
        for name in [n for n in self._parts if n.split()[0] == kind]:
            self._parts.pop(name).remove()


def hit_point(
    origin: Float, direction: Float, points: Float, triangles: Int
) -> tuple[int, Float] | None:
    """The first of the triangles (t, 3) of points (v, 3) that a ray meets, and the weights (3,) of
    its corners there; None where it meets none (Möller & Trumbore 1997)."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    ab, ac, away = b - a, c - a, origin - a
    p = np.cross(direction, ac)
    volume = np.einsum("tj,tj->t", ab, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("tj,tj->t", away, p) / volume
        q = np.cross(away, ab)
        v = q @ direction / volume
        far = np.einsum("tj,tj->t", ac, q) / volume
        met = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (far > 0)
    if not met.any():
        return None
    t = int(np.where(met, far, np.inf).argmin())
    return t, np.array([1 - u[t] - v[t], u[t], v[t]])


def _bytes(colors: Float) -> Any:
    return np.rint(255 * colors).astype(np.uint8)
