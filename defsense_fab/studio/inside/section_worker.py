"""Sections drawn beside the page: dots that follow a hand, and the fine cut once it is still."""

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
from .section_quantities import NEXT_CORD
from .section_picture import Picture, Pictures, Wanted
from .section_view import Clicked, SectionView

_STILL = 0.2  # s without a move, after which the fine section is drawn
_READ = 0.15  # s that browsers get to read a new cut before the old one goes
_ARROW = 0.15  # half the line along which stretch is told, times the body's size
_ABOVE = 0.03  # so far before the section that line lies, times its half
_THIN = 0.6  # cords, times their radius


class SectionWork:
    """The newest section that is wanted, on a thread of its own. `drawn` hears of each fine one and
    its bar as HTML, `failed` of a plane that misses the body."""

    def __init__(
        self,
        bench: Workbench,
        clicked: Clicked,
        drawn: Callable[[Wanted, str], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._bench, self._clicked = bench, clicked
        self._drawn, self._told = drawn, failed  # both while the page's lock is taken
        self._view: SectionView | None = None
        self._pictures: Pictures | None = None
        self.picture: Picture | None = None  # the fine section that is shown
        self.coarse = 0  # how often dots have been drawn
        self._changed = threading.Event()
        self._latest = LatestWorker(self._work, self._failed)

    def open(self, pictures: Pictures, size: float) -> None:
        """Begin to draw a body of a `size` mm."""
        self.shut()
        self._pictures = pictures
        self._view = SectionView(self._bench.server, size, self._clicked)

    def shut(self) -> None:
        """Take away what is drawn, and draw no more."""
        if self._view is not None:
            self._view.close()
        self._view = self.picture = None
        self._changed.set()

    def give(self, wanted: Wanted) -> None:
        """From any thread; returns at once."""
        self._changed.set()
        self._latest.give(wanted)

    def wait(self, seconds: float) -> bool:
        """Whether all that was given is drawn within so many s."""
        return self._latest.wait(seconds)

    def mark(self, point: Float) -> None:
        """A dot at a point (3,) mm until the next section."""
        with self._bench.drawing_lock:
            if self._view is not None:
                self._view.mark(point)

    def close(self) -> None:
        self._changed.set()
        self._latest.close()

    def _work(self, wanted: Wanted) -> None:
        self._changed.clear()
        view, pictures = self._view, self._pictures
        if view is None or pictures is None:
            return
        try:
            if wanted.moving:
                dots = pictures.coarse(wanted)
                with self._bench.drawing_lock:
                    if self._view is not view:
                        return
                    view.show_coarse(*dots)
                    self.coarse += 1
                if self._changed.wait(_STILL):
                    return
            self._draw_fine(view, pictures, replace(wanted, moving=False))
        except LayoutError as error:
            self._missed(view, pictures.body, wanted, error)

    def _missed(
        self, view: SectionView, body: BodySection, wanted: Wanted, error: LayoutError
    ) -> None:
        """The whole body, beside which the plane lies."""
        vertices, faces = body.skin
        vertices = body.carried(vertices, wanted.state)
        with self._bench.drawing_lock:
            if self._view is view:
                self.picture = None
                view.clear()
                view.show_shell(vertices, faces)
                self._told(error)

    def _draw_fine(self, view: SectionView, pictures: Pictures, wanted: Wanted) -> None:
        body, state, size = pictures.body, wanted.state, self._bench.size
        picture = pictures.fine(wanted)
        half, faces = body.half(wanted.plane)
        half, *paths = (body.carried(points, state) for points in (half, *wanted.cords))
        best = _best(wanted)
        best = None if best is None else body.carried(best, state)
        line = _line(wanted, _ARROW * size)
        line = None if line is None else body.carried(line, state)
        radius = _THIN * self._bench.project.device.cord.diameter / 2
        with self._bench.drawing_lock:
            if self._view is not view:
                return
            self.picture = picture
            view.show_fine(picture.positions, picture.section.triangles, picture.colors)
            view.show_shell(half, faces)
            view.show_cords(paths, radius)
            view.show_new(best, 2 * radius)
            view.show_direction(line)
            view.mark(None)
            self._drawn(wanted, picture.bar)
        self._changed.wait(_READ)
        with self._bench.drawing_lock:
            if self._view is view:
                view.settle()

    def _failed(self, error: Exception) -> None:
        with self._bench.drawing_lock:
            self.picture = None
            self._told(error)


def _best(wanted: Wanted) -> Float | None:
    """The path of the cord that would help most."""
    ends = None if wanted.found is None else wanted.found.best_ends
    if wanted.look is not NEXT_CORD or ends is None:
        return None
    return np.asarray(np.linspace(ends[0], ends[1], 30))


def _line(wanted: Wanted, reach: float) -> Float | None:
    """Along which stretch is told, through the middle of the plane."""
    if not wanted.look.along or wanted.path is not None:
        return None
    along = reach * wanted.direction(wanted.plane.origin)
    middle = wanted.plane.origin + _ABOVE * reach * wanted.plane.normal
    return np.linspace(middle - along, middle + along, 12)
