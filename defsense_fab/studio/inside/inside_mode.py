"""The mode in which one sees why a cord lies where it lies, and where the next one would help."""

from __future__ import annotations

from dataclasses import replace

from ...core.arrays import Float
from ...core.curve import Plane, sample_path
from ...core.errors import DefsenseError, LayoutError
from ...optimize.prediction.body_section import BodySection
from ...optimize.prediction.layout_judge import LayoutJudge
from ...optimize.prediction.next_cord import NextCord, best_sensor, shortest_cord
from ..edits.cords import add_cord
from ..edits.edit import free_name
from ..workbench.latest_worker import LatestWorker
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .next_cord import Asked, HeatSearch
from .section_quantities import NEXT_CORD, point_words
from .next_cord import drop_words, NextCordPanel
from .section_planes import PlaneGizmo
from .section_panel import SectionPanel
from .section_picture import Pictures, Wanted
from .section_planes import axis_plane, first_plane, first_state, offsets
from .section_view import hit_point
from .section_worker import SectionWork

_NOT_BUILT = "Simulate the poses first: then the body can be looked into."
_AWAY = 1.6  # of a straight look, times the body's size


class InsideMode(Mode):
    """A section through the body at rest or in a state, in colours, that a gizmo moves."""

    label = "Inside"
    hint = "Cut the body with a plane: how it is stretched there, and where a cord would help."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self._plane: Plane | None = None
        self._gizmo: PlaneGizmo | None = None
        self._pictures: Pictures | None = None
        self._asked: Asked | None = None  # what is sought, or was found or cancelled
        self._found: NextCord | None = None  # of what was asked
        self.work = SectionWork(bench, self.clicked, self._drawn, self._failed)
        self.search = HeatSearch(self._searched, self._map_found, self._search_failed)
        self._prepare = LatestWorker(_prepare, bench.show_error)

    def add_panel(self) -> None:
        bench = self.bench
        self.panel = SectionPanel(bench)
        bench.button("Look straight at it", "Along the plane's normal", self._look_straight)
        self.next = NextCordPanel(bench, self._search_again, self.cancel, self.draw_best)
        bench.command("Look straight at the section", "Along its normal", self._look_straight, "L")
        bench.command("Next state", "The section in the next state", self.next_state, "S")
        self.panel.on_change = lambda: self._ask(moving=False)
        self.panel.on_axis = self._along
        self.panel.on_plane = self.set_plane
        self.panel.on_offset = self._slid

    def enter(self) -> None:
        if self._pictures is None or self._plane is None or self.bench.judge is None:
            self.panel.say(_NOT_BUILT)
            return
        if self.bench.body is not None:
            self.bench.body.visible = False
        self._gizmo = PlaneGizmo(self.bench.server, self.bench.size, self._plane, self.moved)
        self.work.open(self._pictures, self.bench.size)
        self._prepare.give(self.bench.judge)
        self._ask(moving=False)

    def leave(self) -> None:
        self._hide()
        if self.bench.body is not None:
            self.bench.body.visible = True

    def close(self) -> None:
        self.search.close()
        self.work.close()
        self._prepare.close()

    def on_build_loaded(self) -> None:
        shown = self.bench.mode == self.label
        if shown:
            self._hide()
        self._pictures = None
        if self.bench.judge is not None and self.bench.surface is not None:
            task = self.bench.judge.task
            body = BodySection(task.everything.locator, task.everything.fields, task.names)
            self._pictures, self._plane = Pictures(body), first_plane(self._vertices)
            self.panel.built(task.names, first_state(task.weights))
            self.next.begin(shortest_cord(task))
        if shown:
            self.enter()

    def on_device_changed(self) -> None:
        self.panel.cords(self.bench.project.device.sensors)
        self._ask(moving=False)

    def set_plane(self, plane: Plane) -> None:
        """Cut along another plane."""
        self._plane = plane
        if self._gizmo is not None:
            self._gizmo.place(plane)
        self._ask(moving=False)

    def moved(self, plane: Plane, ended: bool) -> None:
        """A hand has the gizmo there, and has perhaps let go."""
        self._plane = plane
        self._ask(moving=not ended)

    def next_state(self) -> None:
        """The section in the state after the one that is shown, rest after the last."""
        self.panel.next_state()
        self._ask(moving=False)

    def cancel(self) -> None:
        """End the search for the place of a cord; a map that is shown stays."""
        self.search.cancel()
        if self._found is None:
            self.next.say("Cancelled. Move the plane, or choose which cords to try, to look again.")

    def draw_best(self) -> None:
        """The cord that lowers the error most, as a cord of the device. Raises LayoutError where
        there is none yet."""
        asked, found, judge = self._asked, self._found, self.bench.judge
        if asked is None or found is None or judge is None:
            raise LayoutError("Wait until it is known where a cord would help; then draw it.")
        if found.best is None:
            raise LayoutError(
                "No cord in this plane lowers the expected error: move the plane, or try cords of"
                " the other kind."
            )
        names = [sensor.name for sensor in self.bench.project.device.sensors]
        cord = best_sensor(found, found.best, free_name("cord", names), judge)
        if self.bench.apply(add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free))):
            told = f"`{cord.name}` drawn: expected error {-found.best_drop:+.2f} mm"
            if asked.length is not None:
                told += ". Its ends lie inside the body: drag them to the skin in Cords"
            self.bench.show_message(told)

    def clicked(self, origin: Float, direction: Float) -> None:
        """Tell what is known where a ray meets the section."""
        picture, pictures = self.work.picture, self._pictures
        if picture is None or pictures is None:
            return
        hit = hit_point(origin, direction, picture.positions, picture.section.triangles)
        if hit is None:
            return
        rest, now, stretches, variance = pictures.at_point(picture, *hit)
        told = point_words(rest, now, stretches, variance)
        if picture.wanted.look is NEXT_CORD and self._found is not None:
            told += f"  \n{drop_words(self._found, rest)}"
        self.panel.say_point(told)
        self.work.mark(now)

    def _along(self, axis: int) -> None:
        if self._pictures is None:
            self.bench.show_message("Simulate the poses first: then there is something to look into.")
            return
        self.set_plane(axis_plane(self._vertices, axis))

    @property
    def _vertices(self) -> Float:
        """Of the body at rest, (v, 3) mm."""
        assert self.bench.surface is not None
        return self.bench.surface.vertices

    def _hide(self) -> None:
        self._forget()
        self.work.shut()
        if self._gizmo is not None:
            self._gizmo.remove()
            self._gizmo = None

    def _slid(self, offset: float) -> None:
        """The plane, so far (mm) from the body's middle along its normal."""
        if self._plane is None:
            return
        by = offset - offsets(self._plane, self._vertices)[0]
        self._plane = replace(self._plane, origin=self._plane.origin + by * self._plane.normal)
        if self._gizmo is not None:
            self._gizmo.place(self._plane)
        self._ask(moving=True)

    def _ask(self, *, moving: bool) -> None:
        """Draw the section as it is wanted now."""
        with self.bench.drawing_lock:
            if self._plane is not None and self._gizmo is not None:
                self._ask_for(self._plane, moving)

    def _ask_for(self, plane: Plane, moving: bool) -> None:
        panel = self.panel
        if self._asked is not None and not self._wanted_still(self._asked):
            self._forget()
        self.next.show(panel.look is NEXT_CORD)
        if panel.look is not NEXT_CORD:
            self.search.cancel()
        sensors = self.bench.project.device.sensors
        self.work.give(
            Wanted(
                plane, panel.state, panel.look, panel.angle,
                None if panel.along is None else sample_path(panel.along),
                tuple(sample_path(sensor) for sensor in sensors),
                self._found, panel.own_range, moving,
            )
        )  # fmt: skip

    def _drawn(self, wanted: Wanted, bar: str) -> None:
        """The fine section is there."""
        self.panel.drawn(offsets(wanted.plane, self._vertices), bar)
        pictures, judge = self._pictures, self.bench.judge
        if wanted.look is not NEXT_CORD or self._asked is not None:
            return
        if pictures is not None and judge is not None and wanted.plane is self._plane:
            sensors = self.bench.project.device.sensors
            self._asked = Asked(judge, pictures.body, wanted.plane, sensors, self.next.length)
            self.next.say("Looking where a cord would help ...")
            self.search.start(self._asked)

    def _wanted_still(self, asked: Asked) -> bool:
        return (
            asked.plane is self._plane
            and asked.judge is self.bench.judge
            and asked.sensors is self.bench.project.device.sensors
            and asked.length == self.next.length
        )

    def _search_again(self) -> None:
        self._forget()
        self._ask(moving=False)

    def _forget(self) -> None:
        """What was sought and found is of another plane, or beside other cords."""
        self.search.cancel()
        self._asked = self._found = None

    def _searched(self, share: float | None) -> None:
        self.next.searched(share)

    def _map_found(self, asked: Asked, found: NextCord) -> None:
        with self.bench.drawing_lock:
            if asked is not self._asked:
                return
            self._found = found
            self.next.say_found(found)
            self._ask(moving=False)

    def _look_straight(self) -> None:
        """All browsers look along the normal at the section."""
        plane = self._plane
        if plane is None:
            return
        place = plane.origin + _AWAY * self.bench.size * plane.normal
        for client in self.bench.server.get_clients().values():
            client.camera.up_direction = tuple(plane.axes[:, 1].tolist())
            client.camera.position = tuple(place.tolist())
            client.camera.look_at = tuple(plane.origin.tolist())

    def _search_failed(self, error: Exception) -> None:
        self.next.say(_words(error))

    def _failed(self, error: Exception) -> None:
        """Told where the section's controls are."""
        self.panel.say(_words(error))


def _words(error: Exception) -> str:
    """Markdown; what is no fault of the person's is told with its kind, for a report."""
    known = isinstance(error, DefsenseError)
    return f"**{error}**" if known else f"**This failed ({type(error).__name__}: {error}).**"


def _prepare(judge: LayoutJudge) -> None:
    """What the first search needs, made while one looks at other things."""
    problem = judge.task.everything
    problem.depth, problem.grid  # noqa: B018 - made once, and kept
