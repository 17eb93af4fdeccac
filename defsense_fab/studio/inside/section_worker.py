"""Draw sections in the background: dots while the plane is dragged, and the fine section after."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.arrays import Float, Int
from ...core.errors import LayoutError
from ...workflow.design.body_section import BodySection
from ..workbench.colors import unlit_mesh
from ..workbench.cord_tubes import add_tube
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench
from .section_picture import SectionPicture, SectionRenderer
from .section_quantities import NEXT_CORD
from .section_samples import SectionRequest

_BODY_COLOR, _CORD_COLOR = (150, 180, 205), (70, 70, 75)
_NEW_CORD_COLOR, _MARK_COLOR = (230, 97, 1), (20, 20, 20)
_DOT_SIZE = 1.1  # times the distance of the dots
_FINE_DELAY_S = 0.2  # without a move of the plane
_READ_TIME_S = 0.15  # in which browsers read a new section before the previous one is removed
_DIRECTION_LENGTH = 0.15  # half the line of the direction, times the body's size
_DIRECTION_HEIGHT = 0.03  # distance of that line from the section, times half its length
_CORD_RADIUS = 0.6  # of the drawn cords, times their radius

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
        self._cords: list[Any] = []
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
                points,
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
                vertices,
                faces,
                color=_BODY_COLOR,
                opacity=0.35,
                side="double",
                cast_shadow=False,
            )

    def show_cords(self, paths: Sequence[Float], radius: float) -> None:
        """Draw cords along paths (p, 3) mm each."""
        for tube in self._cords:
            tube.remove()
        self._cords = [
            add_tube(self._scene, f"/inside/cord/{k}", path, radius, _CORD_COLOR, cast_shadow=False)
            for k, path in enumerate(paths)
        ]

    def show_new_cord(self, path: Float | None, radius: float) -> None:
        """Draw the best additional cord along a path (p, 3) mm, or none."""
        self._remove("new")
        if path is not None:
            self._parts["new"] = add_tube(
                self._scene, "/inside/new", path, radius, _NEW_CORD_COLOR, cast_shadow=False
            )

    def show_direction(self, path: Float | None) -> None:
        """Draw the direction of the stretch as a line (p, 3) mm, or none."""
        self._remove("direction")
        if path is not None:
            self._parts["direction"] = self._scene.add_line_segments(
                "/inside/direction",
                np.stack([path[:-1], path[1:]], axis=1),
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
                position=point,
            )

    def close(self) -> None:
        """Remove all objects and stop listening to clicks."""
        self.clear()
        self._scene.remove_click_callback(self._listener)

    def clear(self) -> None:
        """Remove all objects."""
        for part in (*self._parts.values(), *self._cords, *self._meshes):
            part.remove()
        self._parts, self._cords, self._meshes = {}, [], []
        self.shell = np.zeros((0, 3))

    def _report_click(self, event: Any) -> None:
        self._on_click(np.array(event.ray_origin, float), np.array(event.ray_direction, float))

    def _remove(self, name: str) -> None:
        part = self._parts.pop(name, None)
        if part is not None:
            part.remove()


class SectionWorker:
    """Draw the latest requested section on a thread.

    Args:
        bench: The workbench.
        on_click: Called with the ray of each click in the scene.
        on_drawn: Called with each fine section, while the drawing lock is held.
        on_error: Called with an error, such as a plane that misses the body, while the drawing
            lock is held.

    Attributes:
        picture: The fine section that is shown, or None.
        coarse_count: Number of times that dots were drawn.
    """

    def __init__(
        self,
        bench: Workbench,
        on_click: RayCallback,
        on_drawn: Callable[[SectionPicture], None],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._bench, self._on_click = bench, on_click
        self._on_drawn, self._on_error = on_drawn, on_error
        self._view: SectionView | None = None
        self._renderer: SectionRenderer | None = None
        self.picture: SectionPicture | None = None
        self.coarse_count = 0
        self._changed = threading.Event()
        self._worker = LatestWorker(self._draw, self._report_error)

    @property
    def shell(self) -> Float:
        """Vertices (v, 3) mm of the part of the body that is drawn."""
        return np.zeros((0, 3)) if self._view is None else self._view.shell

    def open(self, renderer: SectionRenderer, size: float) -> None:
        """Start to draw sections of a body.

        Args:
            renderer: Computes the sections.
            size: Size of the body, mm.
        """
        self.hide()
        self._renderer = renderer
        self._view = SectionView(self._bench.server, size, self._on_click)

    def hide(self) -> None:
        """Remove the section, and draw no more until `open`."""
        if self._view is not None:
            self._view.close()
        self._view = self.picture = None
        self._changed.set()

    def give(self, request: SectionRequest) -> None:
        """Request a section and return at once; call it from any thread."""
        self._changed.set()
        self._worker.give(request)

    def wait(self, timeout_s: float) -> bool:
        """Wait until all requests are drawn; return False after `timeout_s`."""
        return self._worker.wait(timeout_s)

    def mark(self, point: Float) -> None:
        """Mark a point (3,) mm until the next section."""
        with self._bench.drawing_lock:
            if self._view is not None:
                self._view.mark(point)

    def close(self) -> None:
        """End the thread."""
        self._changed.set()
        self._worker.close()

    def _draw(self, request: SectionRequest) -> None:
        self._changed.clear()
        view, renderer = self._view, self._renderer
        if view is None or renderer is None:
            return
        try:
            if request.is_moving:
                dots = renderer.coarse(request)
                with self._bench.drawing_lock:
                    if self._view is not view:
                        return
                    view.show_coarse(*dots)
                    self.coarse_count += 1
                if self._changed.wait(_FINE_DELAY_S):
                    return
            self._draw_fine(view, renderer, replace(request, is_moving=False))
        except LayoutError as error:
            self._draw_whole(view, renderer.body, request, error)

    def _draw_whole(
        self, view: SectionView, body: BodySection, request: SectionRequest, error: LayoutError
    ) -> None:
        """Draw the whole body, which the plane misses."""
        vertices, faces = body.skin
        vertices = body.carried(vertices, request.state)
        with self._bench.drawing_lock:
            if self._view is view:
                self.picture = None
                view.clear()
                view.show_shell(vertices, faces)
                self._on_error(error)

    def _draw_fine(
        self, view: SectionView, renderer: SectionRenderer, request: SectionRequest
    ) -> None:
        body, state, size = renderer.body, request.state, self._bench.size
        picture = renderer.fine(request)
        half, faces = body.half(request.plane)
        half, *paths = (body.carried(points, state) for points in (half, *request.cords))
        best = _best_path(request)
        best = None if best is None else body.carried(best, state)
        line = _direction_line(request, _DIRECTION_LENGTH * size)
        line = None if line is None else body.carried(line, state)
        radius = _CORD_RADIUS * self._bench.project.device.cord.diameter / 2
        with self._bench.drawing_lock:
            if self._view is not view:
                return
            self.picture = picture
            view.show_fine(picture.positions, picture.section.triangles, picture.colors)
            view.show_shell(half, faces)
            view.show_cords(paths, radius)
            view.show_new_cord(best, 2 * radius)
            view.show_direction(line)
            view.mark(None)
            self._on_drawn(picture)
        self._changed.wait(_READ_TIME_S)
        with self._bench.drawing_lock:
            if self._view is view:
                view.remove_previous()

    def _report_error(self, error: Exception) -> None:
        with self._bench.drawing_lock:
            self.picture = None
            self._on_error(error)


def _best_path(request: SectionRequest) -> Float | None:
    """Return the path (p, 3) mm of the best additional cord, or None."""
    ends = None if request.next_cord is None else request.next_cord.best_ends
    if request.quantity is not NEXT_CORD or ends is None:
        return None
    return np.asarray(np.linspace(ends[0], ends[1], 30))


def _direction_line(request: SectionRequest, length: float) -> Float | None:
    """Return a line (p, 3) mm through the plane's middle along the direction of the stretch."""
    if not request.quantity.needs_direction or request.path is not None:
        return None
    half = length * request.direction(request.plane.origin)
    middle = request.plane.origin + _DIRECTION_HEIGHT * length * request.plane.normal
    return np.linspace(middle - half, middle + half, 12)


def _to_bytes(colors: Float) -> Any:
    return np.rint(255 * colors).astype(np.uint8)
