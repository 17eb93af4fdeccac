"""A plane to draw on: looked straight at, with the body's outline, and what the hand draws."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import plane_section

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
