"""A section in three dimensions: its colours, the half of the body behind it, cords, marks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...runtime.view.cord_mesh import tube_faces, tube_vertices
from .unlit_mesh import unlit_mesh

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
