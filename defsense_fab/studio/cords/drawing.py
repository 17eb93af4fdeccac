"""The part of the panel with which cords are drawn by hand."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane
from ...core.device.device import Sensor
from ...core.errors import DefsenseError
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import plane_section
from ...optimize.prediction.draw_cord import fit_stroke
from ..workbench.workbench import Workbench

# A plane to draw on: looked straight at, with the body's outline, and what the hand draws.

_PAPER, _OUTLINE, _INK = (150, 150, 150), (31, 119, 180), (230, 120, 20)
_SHEET = 4.0  # times the body's size: strokes begin beside it, too
_ROOM = 1.25  # of what is seen, times the body's size


class Sketch:
    """In a viser server's scene; `done` is called with the stroke (q, 2) mm in the plane, on a
    thread that may take its time."""

    def __init__(
        self, server: Any, surface: Surface, plane: Plane, done: Callable[[Plane, Float], None]
    ) -> None:
        self._scene, self._plane, self._done = server.scene, plane, done
        self._stroke: list[Float] = []
        self._nodes: dict[str, Any] = {}
        corners, self._middle, self._half = _paper(surface, plane)
        paper = self._scene.add_mesh_simple(
            "/sketch/paper", corners.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]]),
            color=_PAPER, opacity=0.08, side="double",
        )  # fmt: skip
        paper.on_drag(self._dragged)
        self._nodes["paper"] = paper
        section = plane.to_world(plane_section(surface, plane))
        if len(section):
            self._nodes["outline"] = self._scene.add_line_segments(
                "/sketch/outline",
                section.astype(np.float32),
                colors=_OUTLINE,
                thickness=2.5,
                thickness_units="screen",
            )

    def look(self, client: Any) -> None:
        """One browser straight at the paper, its x axis to the right."""
        axes, slope = self._plane.axes, float(np.tan(client.camera.fov / 2))
        sides = self._half / np.array([slope * client.camera.aspect, slope])
        place = self._middle + _ROOM * float(sides.max()) * axes[:, 2]
        client.camera.up_direction = tuple(axes[:, 1].tolist())
        client.camera.position = tuple(place.tolist())
        client.camera.look_at = tuple(self._middle.tolist())  # last: moving the camera moves it too

    def close(self) -> None:
        """Take the paper away."""
        for node in self._nodes.values():
            node.remove()
        self._nodes = {}

    async def _dragged(self, event: Any) -> None:
        eye = np.asarray(event.client.camera.position, float)
        place = on_plane(self._plane, eye, np.asarray(event.end_position, float))
        if event.phase == "start":
            first = on_plane(self._plane, eye, np.asarray(event.start_position, float))
            self._stroke = [] if first is None else [first]
        if place is not None:
            self._stroke.append(place)
        self._show()
        if event.phase == "end":
            stroke, self._stroke = np.array(self._stroke), []
            self._show()
            await asyncio.to_thread(self._done, self._plane, stroke)

    def _show(self) -> None:
        if len(self._stroke) < 2:
            ink = self._nodes.pop("ink", None)
            if ink is not None:
                ink.remove()
            return
        line = self._plane.to_world(np.array(self._stroke))
        self._nodes["ink"] = self._scene.add_line_segments(
            "/sketch/ink", np.stack([line[:-1], line[1:]], axis=1).astype(np.float32),
            colors=_INK, thickness=4.0, thickness_units="screen",
        )  # fmt: skip


def on_plane(plane: Plane, eye: Float, seen: Float) -> Float | None:
    """Where the ray from the `eye` (3,) through a point (3,) meets a plane, (2,) mm in it; None
    where it runs along it or away."""
    ray = seen - eye
    rise = float(ray @ plane.normal)
    if abs(rise) < 1e-9 * float(np.linalg.norm(ray)):
        return None
    share = float((plane.origin - eye) @ plane.normal) / rise
    if share <= 0:
        return None
    return np.asarray((eye + share * ray - plane.origin) @ plane.axes[:, :2])


def _paper(surface: Surface, plane: Plane) -> tuple[Float, Float, Float]:
    """Corners (4, 3) mm of a sheet behind the body, its middle (3,), and half of the body's size
    (2,) in the plane."""
    local = (surface.vertices - plane.origin) @ plane.axes[:, :2]
    low, high = local.min(0), local.max(0)
    middle, half = (low + high) / 2, (high - low) / 2
    corners = middle + _SHEET * half.max() * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return plane.to_world(corners), plane.to_world(middle), half


# Planes to draw on: the body's middle ones, and those of cords.

_AXES = "xyz"


def planes(surface: Surface, sensors: Sequence[Sensor]) -> dict[str, Plane]:
    """By what they are called: across the body's thin side first, each with its x axis along the
    body."""
    v = surface.vertices
    middle, extent = (v.min(0) + v.max(0)) / 2, np.ptp(v, axis=0)
    order = np.argsort(extent, kind="stable")
    out = {}
    for axis in order.tolist():
        along = next(a for a in order[::-1].tolist() if a != axis)
        out[f"middle, square to {_AXES[axis]}"] = Plane.from_normal(
            middle, np.eye(3)[axis], np.eye(3)[along]
        )
    return out | {f"of {s.name}": s.plane for s in sensors}


def moved(plane: Plane, by: float) -> Plane:
    """Along its normal, mm."""
    return replace(plane, origin=plane.origin + by * plane.normal)


#: Called with what was drawn.
Drawn = Callable[[Plane, Hermite], None]


class Drawing:
    """A plane is chosen and looked straight at; each stroke on it becomes a cord."""

    def __init__(self, bench: Workbench, drawn: Drawn) -> None:
        self._bench, self._drawn = bench, drawn
        self._sketch: Sketch | None = None

    def add_panel(self) -> None:
        """Its buttons, in the folder that is open."""
        gui = self._bench.server.gui
        self._plane = gui.add_dropdown(
            "Plane", ("none",), hint="That the cord lies in: the body is cut along it"
        )
        self._plane.on_update(lambda event: self._moved(event, new=True))
        self._offset = gui.add_slider(
            "Offset, mm", -1.0, 1.0, 0.5, 0.0, hint="Along the plane's normal"
        )
        self._offset.on_update(lambda event: self._moved(event, new=False))
        self._button = gui.add_button(
            "Draw by hand", hint="Look straight at the plane, and draw with the left button"
        )
        self._button.on_click(lambda event: self._toggled(event.client))

    def offer(self) -> None:
        """The planes that there are now."""
        surface = self._bench.surface
        if surface is None:
            return
        names = tuple(planes(surface, self._bench.project.device.sensors))
        if tuple(self._plane.options) != names:
            kept = self._plane.value
            self._plane.options = names
            self._plane.value = kept if kept in names else names[0]
        self._bound(surface)

    def plane(self) -> Plane | None:
        """That is chosen, at its offset; None while there is no body."""
        surface = self._bench.surface
        if surface is None:
            return None
        known = planes(surface, self._bench.project.device.sensors)
        found = known.get(self._plane.value)
        return None if found is None else moved(found, float(self._offset.value))

    def close(self) -> None:
        """Put the paper away."""
        if self._sketch is not None:
            self._sketch.close()
            self._sketch = None
        self._button.label = "Draw by hand"

    def _bound(self, surface: Surface) -> None:
        """The offset no further than the body."""
        known = planes(surface, self._bench.project.device.sensors)
        plane = known.get(self._plane.value)
        if plane is None:
            return
        heights = (surface.vertices - plane.origin) @ plane.normal
        low, high = float(np.floor(heights.min())), float(np.ceil(heights.max()))
        if (self._offset.min, self._offset.max) != (low, high):
            self._offset.value = 0.0
            self._offset.min, self._offset.max = low, high

    def _moved(self, event: Any, new: bool) -> None:
        surface = self._bench.surface
        if event.client is None or surface is None:  # set by the page itself
            return
        with self._bench.drawing_lock:
            if new:
                self._offset.value = 0.0
                self._bound(surface)
            if self._sketch is not None:
                self._open(surface, event.client)

    def _toggled(self, client: Any) -> None:
        surface = self._bench.surface
        with self._bench.drawing_lock:
            if self._sketch is not None:
                self.close()
            elif surface is None:
                self._bench.show_message("There is no body yet: simulate the poses first.")
            else:
                self._open(surface, client)

    def _open(self, surface: Surface, client: Any) -> None:
        self.close()
        plane = self.plane()
        if plane is None:
            return
        self._sketch = Sketch(self._bench.server, surface, plane, self._done)
        self._button.label = "End drawing"
        if client is not None:
            self._sketch.look(client)

    def _done(self, plane: Plane, stroke: Float) -> None:
        surface = self._bench.surface
        if surface is None:
            return
        try:
            self._drawn(plane, fit_stroke(surface, plane, stroke))
        except DefsenseError as error:
            self._bench.show_error(error)
