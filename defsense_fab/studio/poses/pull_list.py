"""The points of the body that a pose pulls by springs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.device import PointDrag, Pose
from ...workflow.view import intersect_ray
from ..edits.poses import drag_point, remove_drag, stiffen_drag
from ..workbench.controls import NONE, add_field, device_field, on_user
from .poses_scene import PosesScene

_STIFFNESS_KEY = "poses.drags.stiffness"
_INITIAL_PULL = 0.15  # of a new pull, times the body's size
_LINE_COLOR = (213, 94, 0)


class PullList:
    """The controls and lines of the pulls of the pose that is shown.

    Args:
        scene: The body and its gizmos.
    """

    def __init__(self, scene: PosesScene) -> None:
        self._scene, self._bench = scene, scene.bench
        self._pose: Pose | None = None
        self._lines: Any = None

    @property
    def takes_clicks(self) -> bool:
        """Whether a click on the body pulls at the point."""
        return bool(self._click_switch.value)

    @takes_clicks.setter
    def takes_clicks(self, value: bool) -> None:
        self._click_switch.value = value

    @property
    def names(self) -> tuple[str, ...]:
        """Labels of the pulls of the shown pose."""
        return () if self._pose is None else tuple(_label(pull) for pull in self._pose.drags)

    @property
    def has_lines(self) -> bool:
        """Whether the pulls are drawn in the scene."""
        return self._lines is not None

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, button = self._bench.server.gui, self._bench.button
        self._folder = gui.add_folder("Pulled points")
        with self._folder:
            self._click_switch = gui.add_checkbox(
                "Click to pull", False, hint="Pull at a point of the body by clicking it"
            )
            self._click_switch.on_update(lambda _: self.update_clicks())
            self._list = gui.add_dropdown(
                "Pull", (NONE,), hint="Choose a pull. Its gizmo sets where to"
            )
            self._list.on_update(lambda _: self._show_stiffness())
            self._stiffness = add_field(gui, _STIFFNESS_KEY, step=0.1)
            on_user(self._stiffness, lambda value: self.stiffen(float(value)))
            self._remove = button("Remove the pull", "Remove the chosen pull", self.remove)

    def show(self, pose: Pose | None) -> None:
        """Show the pulls of a pose."""
        self._pose = pose
        self._folder.visible = pose is not None
        names, before = self.names, self._list.value
        self._list.options = names or (NONE,)
        if names and before not in names:
            self._list.value = names[-1]
        for control in (self._list, self._stiffness, self._remove):
            control.visible = bool(names)
        self._show_stiffness()
        self.draw()

    def update_clicks(self) -> None:
        """Take clicks on the body if the user wants to pull."""
        if self._scene.body is not None:
            self._scene.body.take_clicks(self._pose is not None and self.takes_clicks)

    def click(self, event: Any) -> None:
        """Pull at the point of the body that the user has clicked."""
        self.pull(np.asarray(event.ray_origin, float), np.asarray(event.ray_direction, float))

    def pull(self, origin: Float, direction: Float) -> None:
        """Pull outwards at the point where a ray meets the body.

        Args:
            origin: Origin of the ray (3,) mm.
            direction: Its direction (3,).
        """
        body, pose = self._scene.body, self._pose
        if body is None or pose is None:
            return
        hit = intersect_ray(body.vertices, body.faces, origin, direction)
        if hit is None:
            self._bench.status.show("No point of the body is there. Click it.", "no-body-point")
            return
        face, weights = hit
        point = weights @ body.rest[body.faces[face]]
        a, b, c = body.vertices[body.faces[face]]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        by = np.round(_INITIAL_PULL * self._scene.size * normal, 1)
        self.takes_clicks = False
        stiffness = float(device_field(_STIFFNESS_KEY).default)
        self._bench.apply(drag_point(pose.name, np.round(point, 2), by, stiffness))

    def remove(self) -> None:
        """Remove the chosen pull."""
        pull = self._chosen_pull()
        if pull is not None and self._pose is not None:
            self._bench.apply(remove_drag(self._pose.name, pull.at))

    def stiffen(self, stiffness: float) -> None:
        """Set the stiffness of the chosen pull's spring, N/mm."""
        pull = self._chosen_pull()
        if pull is not None and self._pose is not None:
            self._bench.apply(stiffen_drag(self._pose.name, pull.at, stiffness))

    def draw(self, pose: Pose | None = None) -> None:
        """Draw lines from the pulled points to their goals.

        Args:
            pose: The pose while the user drags it; by default as the device has it.
        """
        pose = pose or self._pose
        if self._lines is not None:
            self._lines.remove()
            self._lines = None
        body = self._scene.body
        if pose is None or body is None or not pose.drags or self._scene.gizmos is None:
            return
        ends = []
        for pull in pose.drags:
            nearest = int(np.linalg.norm(body.rest - pull.at, axis=1).argmin())
            point = pull.at + body.vertices[nearest] - body.rest[nearest]
            ends.append([point, pull.at + pull.by])
        self._lines = self._bench.server.scene.add_line_segments(
            "/poses/pulls",
            np.array(ends, np.float32),
            _LINE_COLOR,
            thickness=4.0,
            thickness_units="screen",
        )

    def clear(self) -> None:
        """Remove the lines, and take no clicks."""
        self._pose = None
        self.draw()
        self.update_clicks()

    def _show_stiffness(self) -> None:
        pull = self._chosen_pull()
        if pull is not None:
            self._stiffness.value = pull.stiffness

    def _chosen_pull(self) -> PointDrag | None:
        pulls = () if self._pose is None else self._pose.drags
        return next((pull for pull in pulls if _label(pull) == self._list.value), None)


def _label(pull: PointDrag) -> str:
    return "at " + ", ".join(f"{v:g}" for v in pull.at)
