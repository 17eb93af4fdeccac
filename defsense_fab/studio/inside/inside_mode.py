"""The mode that shows the stretch inside the body, and where another cord would help."""

from __future__ import annotations

from dataclasses import replace

from ...core.arrays import Float
from ...core.curve import Plane, sample_path
from ...core.errors import LayoutError
from ...workflow.design.body_section import BodySection
from ...workflow.design.layout_judge import LayoutJudge
from ...workflow.design.next_cord import NextCord, best_sensor, shortest_cord
from ...workflow.view import intersect_ray, place_camera
from ..edits.cords import add_cord
from ..edits.edit import free_name
from ..workbench.latest_worker import LatestWorker
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .next_cord import NextCordPanel
from .next_cord_search import NextCordSearch, SearchRequest, drop_text
from .plane_gizmo import PlaneGizmo
from .section_panel import SectionPanel
from .section_picture import SectionPicture, SectionRenderer
from .section_planes import axis_plane, first_plane, first_state, plane_offsets
from .section_quantities import NEXT_CORD
from .section_samples import SectionRequest
from .section_worker import SectionWorker

_NOT_SIMULATED = "Simulate the poses first to see the inside of the body."
_VIEW_DISTANCE = 1.6  # of the camera from the section, times the body's size


class InsideMode(Mode):
    """Show a section through the body at rest or in a state, with a handle that moves it.

    Attributes:
        plane: Plane of the section, or None before a build.
        cord_map: The map of the benefit of another cord, or None.
        search_request: The search that runs or has ended, or None.
        sections: Draws the sections.
        search: Searches for the best place of another cord.
        panel: The section's controls.
        next_panel: The search's controls.
    """

    label = "Inside"
    hint = "Cut the body with a plane to see its stretch, and where another cord would help."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.plane: Plane | None = None
        self.cord_map: NextCord | None = None
        self.search_request: SearchRequest | None = None
        self.sections = SectionWorker(bench, self.click, self._show_section, self._show_error)
        self.search = NextCordSearch(
            lambda share: self.next_panel.show_progress(share),
            self._show_map,
            lambda error: self.next_panel.show_error(error),
        )
        self._gizmo: PlaneGizmo | None = None
        self._renderer: SectionRenderer | None = None
        self._preparation = LatestWorker(_prepare_search, bench.status.show_error)

    @property
    def vertices(self) -> Float:
        """Vertices of the body at rest, (v, 3) mm; only after a build."""
        assert self.bench.surface is not None
        return self.bench.surface.vertices

    def add_panel(self) -> None:
        bench = self.bench
        self.panel = SectionPanel(bench)
        bench.button(
            "Face the section", "Point the camera along the plane's normal", self._face_section
        )
        self.next_panel = NextCordPanel(bench, self._restart_search, self.cancel, self.draw_best)
        bench.command(
            "Face the section", "Point the camera at the section", self._face_section, "L"
        )
        bench.command("Next state", "Show the section in the next state", self.next_state, "S")
        self.panel.on_change = lambda: self._request_section(is_moving=False)
        self.panel.on_axis = self._set_axis
        self.panel.on_plane = self.set_plane
        self.panel.on_offset = self._set_offset

    def enter(self) -> None:
        if self._renderer is None or self.plane is None or self.bench.judge is None:
            self.panel.status.show(_NOT_SIMULATED, "not-simulated")
            return
        if self.bench.body is not None:
            self.bench.body.visible = False
        self._gizmo = PlaneGizmo(self.bench.server, self.bench.size, self.plane, self.move_plane)
        self.sections.open(self._renderer, self.bench.size)
        self._preparation.give(self.bench.judge)
        self._request_section(is_moving=False)

    def leave(self) -> None:
        self._hide()
        if self.bench.body is not None:
            self.bench.body.visible = True

    def close(self) -> None:
        self.search.close()
        self.sections.close()
        self._preparation.close()

    def on_build_loaded(self) -> None:
        if self.is_active:
            self._hide()
        self._renderer = None
        if self.bench.judge is not None and self.bench.surface is not None:
            task = self.bench.judge.task
            body = BodySection(task.everything.locator, task.everything.fields, task.names)
            self._renderer, self.plane = SectionRenderer(body), first_plane(self.vertices)
            self.panel.set_states(task.names, first_state(task.weights))
            self.next_panel.set_default_length(shortest_cord(task))
        if self.is_active:
            self.enter()

    def on_device_changed(self) -> None:
        self.panel.set_cords(self.bench.project.device.sensors)
        self._request_section(is_moving=False)

    def set_plane(self, plane: Plane) -> None:
        """Cut along another plane."""
        self.plane = plane
        if self._gizmo is not None:
            self._gizmo.place(plane)
        self._request_section(is_moving=False)

    def move_plane(self, plane: Plane, has_ended: bool) -> None:
        """Follow the drag of the handle, which may have ended."""
        self.plane = plane
        self._request_section(is_moving=not has_ended)

    def next_state(self) -> None:
        """Show the section in the next state, and at rest after the last."""
        self.panel.choose_next_state()
        self._request_section(is_moving=False)

    def cancel(self) -> None:
        """Cancel the search for the best place of a cord; a map that is shown stays."""
        self.search.cancel()
        if self.cord_map is None:
            self.next_panel.show_cancelled()

    def draw_best(self) -> None:
        """Add the cord that lowers the error most to the device.

        Raises:
            LayoutError: The search has not ended, or no cord lowers the error.
        """
        request, cord_map, judge = self.search_request, self.cord_map, self.bench.judge
        if request is None or cord_map is None or judge is None:
            raise LayoutError(
                "the best place of a cord is not known yet",
                code="search-not-done",
                action="Wait until the search has ended",
            )
        if cord_map.best is None:
            raise LayoutError(
                "no cord in this plane lowers the expected error",
                code="no-better-cord",
                action="Move the plane, or try cords of the other kind",
            )
        names = [sensor.name for sensor in self.bench.project.device.sensors]
        cord = best_sensor(cord_map, cord_map.best, free_name("cord", names), judge)
        if self.bench.apply(add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free))):
            text = f"Added `{cord.name}`. Expected error: {-cord_map.best_drop:+.2f} mm"
            if request.length is not None:
                text += ". Its ends are inside the body; drag them to the surface in *Cords*"
            self.bench.status.show(text, "cord-drawn")

    def click(self, origin: Float, direction: Float) -> None:
        """Show the numbers of the point where a ray meets the section.

        Args:
            origin: Origin of the ray (3,) mm.
            direction: Its direction (3,).
        """
        picture, renderer = self.sections.picture, self._renderer
        if picture is None or renderer is None:
            return
        hit = intersect_ray(picture.positions, picture.section.triangles, origin, direction)
        if hit is None:
            return
        values = renderer.probe(picture, *hit)
        note = ""
        if picture.request.quantity is NEXT_CORD and self.cord_map is not None:
            note = drop_text(self.cord_map, values.rest)
        self.panel.show_point(values, note)
        self.sections.mark(values.position)

    def _set_axis(self, axis: int) -> None:
        if self._renderer is None:
            self.bench.status.show(_NOT_SIMULATED, "not-simulated")
            return
        self.set_plane(axis_plane(self.vertices, axis))

    def _hide(self) -> None:
        self._forget_search()
        self.sections.hide()
        if self._gizmo is not None:
            self._gizmo.remove()
            self._gizmo = None

    def _set_offset(self, offset: float) -> None:
        """Move the plane along its normal to an offset (mm) from the body's middle."""
        if self.plane is None:
            return
        distance = offset - plane_offsets(self.plane, self.vertices)[0]
        self.plane = replace(self.plane, origin=self.plane.origin + distance * self.plane.normal)
        if self._gizmo is not None:
            self._gizmo.place(self.plane)
        self._request_section(is_moving=True)

    def _request_section(self, *, is_moving: bool) -> None:
        """Draw the section that the controls describe, if the mode is active."""
        with self.bench.drawing_lock:
            if self.plane is None or self._gizmo is None:
                return
            panel = self.panel
            if self.search_request is not None and not self._is_current(self.search_request):
                self._forget_search()
            self.next_panel.show(panel.quantity is NEXT_CORD)
            if panel.quantity is not NEXT_CORD:
                self.search.cancel()
            cord = panel.direction_cord
            self.sections.give(
                SectionRequest(
                    plane=self.plane,
                    state=panel.state,
                    quantity=panel.quantity,
                    angle=panel.angle,
                    path=None if cord is None else sample_path(cord),
                    cords=tuple(sample_path(s) for s in self.bench.project.device.sensors),
                    next_cord=self.cord_map,
                    has_state_range=panel.has_state_range,
                    is_moving=is_moving,
                )
            )

    def _show_section(self, picture: SectionPicture) -> None:
        """Show the numbers of a fine section, and start the search if it needs one."""
        request = picture.request
        offset, *limits = plane_offsets(request.plane, self.vertices)
        self.panel.show_section(picture, offset, (limits[0], limits[1]))
        renderer, judge = self._renderer, self.bench.judge
        if request.quantity is not NEXT_CORD or self.search_request is not None:
            return
        if renderer is not None and judge is not None and request.plane is self.plane:
            sensors = self.bench.project.device.sensors
            self.search_request = SearchRequest(
                judge, renderer.body, request.plane, sensors, self.next_panel.length
            )
            self.next_panel.show_start()
            self.search.start(self.search_request)

    def _is_current(self, request: SearchRequest) -> bool:
        return (
            request.plane is self.plane
            and request.judge is self.bench.judge
            and request.sensors is self.bench.project.device.sensors
            and request.length == self.next_panel.length
        )

    def _restart_search(self) -> None:
        self._forget_search()
        self._request_section(is_moving=False)

    def _forget_search(self) -> None:
        """Forget a search and a map of another plane or other cords."""
        self.search.cancel()
        self.search_request = self.cord_map = None

    def _show_map(self, request: SearchRequest, cord_map: NextCord) -> None:
        with self.bench.drawing_lock:
            if request is not self.search_request:
                return
            self.cord_map = cord_map
            self.next_panel.show_map(cord_map)
            self._request_section(is_moving=False)

    def _face_section(self) -> None:
        """Point the cameras of all browsers along the normal at the section."""
        plane = self.plane
        if plane is None:
            return
        position = plane.origin + _VIEW_DISTANCE * self.bench.size * plane.normal
        for client in self.bench.server.get_clients().values():
            place_camera(client, position, plane.origin, plane.axes[:, 1])

    def _show_error(self, error: Exception) -> None:
        """Show an error next to the section's controls."""
        self.panel.status.show_error(error, "The section")


def _prepare_search(judge: LayoutJudge) -> None:
    """Compute the cached properties that the first search needs, before the user asks for it."""
    problem = judge.task.everything
    problem.depth, problem.grid  # noqa: B018 - properties that cache their values
