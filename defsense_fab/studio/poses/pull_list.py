"""Points of the body that a pose pulls with a spring."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.device import PointDrag, Pose
from ...runtime.view.camera import intersect_ray
from ..edits.poses import drag_point, remove_drag, stiffen_drag
from .poses_scene import PosesScene

NONE = "none"
_FAR = 0.15  # of the body: how far a point is pulled to begin with
_SOFT = 1.0  # N/mm, to begin with
_LINE = (213, 94, 0)


class PullList:
    """In a folder of the panel, of the pose that is `show`n."""

    def __init__(self, scene: PosesScene) -> None:
        self._scene, self._bench = scene, scene.bench
        self._pose: Pose | None = None
        self._lines: Any = None
        self._filling = False

    def add_panel(self) -> None:
        """In the folder that is open."""
        gui, button = self._bench.server.gui, self._bench.button
        self._folder = gui.add_folder("Points that are pulled")
        with self._folder:
            self._clicks = gui.add_checkbox(
                "Click to pull", False, hint="A click on the body pulls at that point by a spring"
            )
            self._clicks.on_update(lambda _: self.listen())
            self._list = gui.add_dropdown("Pull", (NONE,), hint="Its gizmo says where to")
            self._list.on_update(lambda _: self._fill())
            self._stiffness = gui.add_number(
                "Spring", _SOFT, min=0.001, step=0.1, hint="N/mm; a stiff one comes nearer"
            )
            self._stiffness.on_update(lambda event: self._stiffened(event))
            self._remove = button("Pull no more", "The chosen one", self.remove)

    def show(self, pose: Pose | None) -> None:
        """The pulls that a pose has now."""
        self._pose = pose
        self._folder.visible = pose is not None
        names = [] if pose is None else [_name(d) for d in pose.drags]
        before = self._list.value
        self._list.options = tuple(names) or (NONE,)
        if names:
            self._list.value = before if before in names else names[-1]
        for part in (self._list, self._stiffness, self._remove):
            part.visible = bool(names)
        self._fill()
        self.draw()

    def listen(self) -> None:
        """Take clicks on the body while that is asked for."""
        if self._scene.body is not None:
            self._scene.body.take_clicks(self._pose is not None and self._clicks.value)

    def clicked(self, event: Any) -> None:
        """A click on the body."""
        self.pull(np.asarray(event.ray_origin, float), np.asarray(event.ray_direction, float))

    def pull(self, origin: Float, direction: Float) -> None:
        """At the point of the body that a ray meets, outwards."""
        body, pose = self._scene.body, self._pose
        if body is None or pose is None:
            return
        met = intersect_ray(body.vertices, body.faces, origin, direction)
        if met is None:
            self._bench.show_message(
                "There is no point of the body at this place.", "no-body-point"
            )
            return
        face, weights = met
        at = weights @ body.rest[body.faces[face]]
        a, b, c = body.vertices[body.faces[face]]
        normal = np.cross(b - a, c - a)
        by = np.round(_FAR * self._scene.size * normal / np.linalg.norm(normal), 1)
        self._clicks.value = False
        self._bench.apply(
            drag_point(pose.name, np.asarray(np.round(at, 2)), np.asarray(by, float), _SOFT)
        )

    def remove(self) -> None:
        """The chosen pull."""
        drag = self._drag()
        if drag is not None and self._pose is not None:
            self._bench.apply(remove_drag(self._pose.name, drag.at))

    def stiffen(self, stiffness: float) -> None:
        """The chosen pull's spring, N/mm."""
        drag = self._drag()
        if drag is not None and self._pose is not None:
            self._bench.apply(stiffen_drag(self._pose.name, drag.at, stiffness))

    def draw(self, pose: Pose | None = None) -> None:
        """Lines from points to what they are pulled to, in the pose as a hand has it."""
        pose = pose or self._pose
        if self._lines is not None:
            self._lines.remove()
            self._lines = None
        body = self._scene.body
        if pose is None or body is None or not pose.drags or self._scene.gizmos is None:
            return
        ends = []
        for d in pose.drags:
            near = int(np.linalg.norm(body.rest - d.at, axis=1).argmin())
            ends.append([d.at + body.vertices[near] - body.rest[near], d.at + d.by])
        self._lines = self._bench.server.scene.add_line_segments(
            "/poses/pulls",
            np.array(ends, np.float32),
            _LINE,
            thickness=4.0,
            thickness_units="screen",
        )

    def clear(self) -> None:
        """Out of the scene."""
        self._pose = None
        self.draw()
        self.listen()

    def _fill(self) -> None:
        drag = self._drag()
        if drag is not None:
            self._filling = True
            self._stiffness.value = drag.stiffness
            self._filling = False

    def _stiffened(self, event: Any) -> None:
        if event.client is not None and not self._filling:
            self.stiffen(float(self._stiffness.value))

    def _drag(self) -> PointDrag | None:
        drags = () if self._pose is None else self._pose.drags
        return next((d for d in drags if _name(d) == self._list.value), None)


def _name(drag: PointDrag) -> str:
    return "at " + ", ".join(f"{v:g}" for v in drag.at)
