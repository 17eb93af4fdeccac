"""Draw sections in the background: dots while the plane is dragged, and the fine section after."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...core.arrays import Float
from ...core.errors import LayoutError
from ...optimize.prediction.body_section import BodySection
from ..workbench.latest_worker import LatestWorker
from ..workbench.workbench import Workbench
from .section_picture import SectionPicture, SectionRenderer, SectionRequest
from .section_quantities import NEXT_CORD
from .section_view import RayCallback, SectionView

_FINE_DELAY_S = 0.2  # without a move of the plane
_READ_TIME_S = 0.15  # in which browsers read a new section before the previous one is removed
_DIRECTION_LENGTH = 0.15  # half the line of the direction, times the body's size
_DIRECTION_HEIGHT = 0.03  # distance of that line from the section, times half its length
_CORD_RADIUS = 0.6  # of the drawn cords, times their radius


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
