"""Draw cords by strokes on a plane through the body."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane
from ...core.errors import DefsenseError
from ...core.mesh import Surface
from ...workflow.design.draw_cord import (
    drawing_planes,
    fit_stroke,
    offset_plane,
    plane_section,
    ray_on_plane,
)
from ...workflow.view import place_camera
from ..workbench.workbench import Workbench

_PAPER_COLOR, _OUTLINE_COLOR, _INK_COLOR = (150, 150, 150), (31, 119, 180), (230, 120, 20)
_PAPER_SIZE = 4.0  # times the body's size: strokes may start outside the body
_VIEW_SIZE = 1.25  # times the body's size
_START_LABEL, _END_LABEL = "Draw by hand", "End drawing"


class DrawingPanel:
    """Controls that choose a plane and draw on it; each stroke becomes a cord.

    Args:
        bench: The workbench.
        on_drawn: Called with the plane and the curve of each stroke.
    """

    def __init__(self, bench: Workbench, on_drawn: Callable[[Plane, Hermite], None]) -> None:
        self._bench, self._on_drawn = bench, on_drawn
        self._sketch: _Sketch | None = None

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui = self._bench.server.gui
        self._plane = gui.add_dropdown(
            "Plane", ("none",), hint="Choose the plane of the new cord. The body is cut along it"
        )
        self._plane.on_update(lambda event: self._follow_controls(event, is_new_plane=True))
        self._offset = gui.add_slider(
            "Offset (mm)", -1.0, 1.0, 0.5, 0.0, hint="Move the plane along its normal"
        )
        self._offset.on_update(lambda event: self._follow_controls(event, is_new_plane=False))
        self._button = gui.add_button(
            _START_LABEL, hint="Look straight at the plane and draw with the left mouse button"
        )
        self._button.on_click(lambda event: self._toggle(event.client))

    def update(self) -> None:
        """Offer the planes of the device's current body and cords."""
        surface = self._bench.surface
        if surface is None:
            return
        self._plane.options = tuple(drawing_planes(surface, self._bench.project.device.sensors))
        self._limit_offset(surface)

    def plane(self) -> Plane | None:
        """Return the chosen plane at its offset, or None while there is no body."""
        surface = self._bench.surface
        if surface is None:
            return None
        planes = drawing_planes(surface, self._bench.project.device.sensors)
        plane = planes.get(self._plane.value)
        return None if plane is None else offset_plane(plane, float(self._offset.value))

    def finish_stroke(self, plane: Plane, stroke: Float) -> None:
        """Fit a curve to a stroke (q, 2) mm in a plane and pass it on; show errors on the page."""
        surface = self._bench.surface
        if surface is None:
            return
        try:
            self._on_drawn(plane, fit_stroke(surface, plane, stroke))
        except DefsenseError as error:
            self._bench.status.show_error(error)

    def close(self) -> None:
        """Remove the drawing paper."""
        if self._sketch is not None:
            self._sketch.close()
            self._sketch = None
        self._button.label = _START_LABEL

    def _limit_offset(self, surface: Surface) -> None:
        """Limit the offset to the extent of the body."""
        planes = drawing_planes(surface, self._bench.project.device.sensors)
        plane = planes.get(self._plane.value)
        if plane is None:
            return
        heights = (surface.vertices - plane.origin) @ plane.normal
        low, high = float(np.floor(heights.min())), float(np.ceil(heights.max()))
        if (self._offset.min, self._offset.max) != (low, high):
            self._offset.value = 0.0
            self._offset.min, self._offset.max = low, high

    def _follow_controls(self, event: Any, *, is_new_plane: bool) -> None:
        surface = self._bench.surface
        if event.client is None or surface is None:  # set by the program, not by a user
            return
        with self._bench.drawing_lock:
            if is_new_plane:
                self._offset.value = 0.0
                self._limit_offset(surface)
            if self._sketch is not None:
                self._open(surface, event.client)

    def _toggle(self, client: Any) -> None:
        surface = self._bench.surface
        with self._bench.drawing_lock:
            if self._sketch is not None:
                self.close()
            elif surface is None:
                self._bench.status.show("No body yet. Simulate the poses first.", "no-body")
            else:
                self._open(surface, client)

    def _open(self, surface: Surface, client: Any) -> None:
        self.close()
        plane = self.plane()
        if plane is None:
            return
        self._sketch = _Sketch(self._bench.server, surface, plane, self.finish_stroke)
        self._button.label = _END_LABEL
        if client is not None:
            self._sketch.look(client)


class _Sketch:
    """Paper in the scene with the body's outline and the current stroke.

    `on_stroke` is called with the plane and the stroke (q, 2) mm, on a thread that may block.
    """

    def __init__(
        self,
        server: Any,
        surface: Surface,
        plane: Plane,
        on_stroke: Callable[[Plane, Float], None],
    ) -> None:
        self._scene, self._plane, self._on_stroke = server.scene, plane, on_stroke
        self._stroke: list[Float] = []
        self._nodes: dict[str, Any] = {}
        corners, self._middle, self._half_size = _paper(surface, plane)
        paper = self._scene.add_mesh_simple(
            "/sketch/paper",
            corners,
            np.array([[0, 1, 2], [0, 2, 3]]),
            color=_PAPER_COLOR,
            opacity=0.08,
            side="double",
        )
        paper.on_drag(self._drag)
        self._nodes["paper"] = paper
        section = plane.to_world(plane_section(surface, plane))
        if len(section):
            self._nodes["outline"] = self._scene.add_line_segments(
                "/sketch/outline",
                section,
                colors=_OUTLINE_COLOR,
                thickness=2.5,
                thickness_units="screen",
            )

    def look(self, client: Any) -> None:
        """Point one browser's camera straight at the paper, with the plane's x axis right."""
        axes, slope = self._plane.axes, float(np.tan(client.camera.fov / 2))
        distances = self._half_size / np.array([slope * client.camera.aspect, slope])
        position = self._middle + _VIEW_SIZE * float(distances.max()) * axes[:, 2]
        place_camera(client, position, self._middle, axes[:, 1])

    def close(self) -> None:
        for node in self._nodes.values():
            node.remove()
        self._nodes = {}

    async def _drag(self, event: Any) -> None:
        eye = np.asarray(event.client.camera.position, float)
        point = ray_on_plane(self._plane, eye, np.asarray(event.end_position, float))
        if event.phase == "start":
            first = ray_on_plane(self._plane, eye, np.asarray(event.start_position, float))
            self._stroke = [] if first is None else [first]
        if point is not None:
            self._stroke.append(point)
        self._show_stroke()
        if event.phase == "end":
            stroke, self._stroke = np.array(self._stroke), []
            self._show_stroke()
            await asyncio.to_thread(self._on_stroke, self._plane, stroke)

    def _show_stroke(self) -> None:
        if len(self._stroke) < 2:
            ink = self._nodes.pop("ink", None)
            if ink is not None:
                ink.remove()
            return
        line = self._plane.to_world(np.array(self._stroke))
        self._nodes["ink"] = self._scene.add_line_segments(
            "/sketch/ink",
            np.stack([line[:-1], line[1:]], axis=1),
            colors=_INK_COLOR,
            thickness=4.0,
            thickness_units="screen",
        )


def _paper(surface: Surface, plane: Plane) -> tuple[Float, Float, Float]:
    """Return the paper's corners (4, 3), its middle (3,) and half the body's size (2,), mm."""
    local = (surface.vertices - plane.origin) @ plane.axes[:, :2]
    low, high = local.min(0), local.max(0)
    middle, half = (low + high) / 2, (high - low) / 2
    corners = middle + _PAPER_SIZE * half.max() * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return plane.to_world(corners), plane.to_world(middle), half
