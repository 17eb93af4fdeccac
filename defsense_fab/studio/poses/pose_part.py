"""The poses of the device: choose one, and change it while the body follows."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device, Pose
from ...core.errors import DefsenseError
from ...workflow.design.pose_ramp import unreached_message
from ...workflow.design.region_points import points_in_regions
from ..edits.edit import Edit, free_name
from ..edits.poses import (
    PoseRole,
    add_pose,
    duplicate_pose,
    pose_edits,
    remove_pose,
    rename_pose,
    role_of,
    set_role,
)
from ..workbench.controls import NONE, add_field, on_user
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench
from .grips import move_grip, pose_grips, rotation_center
from .poses_scene import PosesScene
from .preview_work import PreviewAnswer, PreviewRequest
from .pull_list import PullList
from .ramp_part import RampPart

_NOT_MESHED = "Mesh the body first. Poses are solved on its mesh."
_TOO_FEW_REGIONS = "Add two regions first: one to hold and one to move."

_ROLE_LABELS: dict[PoseRole, str] = {
    "free": "free",
    "held": "held",
    "turned": "turned, position free",
    "moved": "turned and shifted",
}
_ROLES = {label: role for role, label in _ROLE_LABELS.items()}
#: State of the shown pose: "coarse" and "solved" while the user changes it or at a share of its
#: ramp, "checked" if it was solved as a build does, and "invalid" if its equilibrium is not.
ShapeState = Literal[
    "none",
    "solving",
    "coarse",
    "solved",
    "checked",
    "cancelled",
    "not-reached",
    "invalid",
]


class RoleList:
    """A drop-down for each region of the device.

    Args:
        bench: The workbench.
        on_choose: Called with a region and the role that the user has chosen.
    """

    def __init__(self, bench: Workbench, on_choose: Callable[[str, PoseRole], None]) -> None:
        self._bench, self._on_choose = bench, on_choose
        self._lists: dict[str, Any] = {}

    @property
    def roles(self) -> dict[str, PoseRole]:
        """The shown role of each region."""
        return {region: _ROLES[control.value] for region, control in self._lists.items()}

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        self._folder = self._bench.server.gui.add_folder("Roles of the regions")

    def show(self, device: Device, pose: Pose | None) -> None:
        """Show what a pose does with the regions."""
        regions = list(device.regions)
        if list(self._lists) != regions:
            for control in self._lists.values():
                control.remove()
            with self._folder:
                self._lists = {region: self._add_list(region) for region in regions}
        self._folder.visible = pose is not None
        if pose is not None:
            for region, control in self._lists.items():
                control.value = _ROLE_LABELS[role_of(pose, region)]

    def _add_list(self, region: str) -> Any:
        control = self._bench.server.gui.add_dropdown(
            region,
            tuple(_ROLES),
            hint="Choose what the pose does with the region. Gizmos move it: rings turn, arrows"
            " shift",
        )

        on_user(control, lambda label: self._on_choose(region, _ROLES[label]))
        return control


class PosePart:
    """The controls of the chosen pose.

    Args:
        scene: The body and its gizmos.
        ramp: The controls of the pose's ramp.

    Attributes:
        chosen: Name of the chosen pose, or None.
        roles: What the pose does with each region.
        pulls: The points that the pose pulls.
        status: State of the shape that is shown, a `ShapeState`, or the error of a pose that the
            body cannot have.
        centers: Centers (3,) mm of moved regions in the solved pose, by region.
    """

    def __init__(self, scene: PosesScene, ramp: RampPart) -> None:
        self._scene, self._bench, self._ramp = scene, scene.bench, ramp
        self.chosen: str | None = None
        self.roles, self.pulls = RoleList(scene.bench, self.set_role), PullList(scene)
        self.status = StatusText(_NOT_MESHED, "none")
        self.centers: dict[str, Float] = {}
        self._is_shown = self._is_dragging = False
        self._requested_pose: str | None = None  # name of the pose that was requested last
        self._last_shape: Float | None = None  # vertices (v, 3) mm of the last fine shape

    @property
    def pose(self) -> Pose | None:
        """The chosen pose of the device."""
        poses = self._bench.project.device.poses
        return next((pose for pose in poses if pose.name == self.chosen), None)

    @property
    def new_name(self) -> str:
        """The name in the field, which `rename` gives to the chosen pose."""
        return str(self._name.value).strip()

    @new_name.setter
    def new_name(self, name: str) -> None:
        self._name.value = name

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui = self._bench.server.gui
        self._list = gui.add_dropdown(
            "Pose", (NONE,), hint="Choose the pose that is shown and has gizmos"
        )
        on_user(self._list, self._choose_from_list)
        self.status.add_panel(gui)
        self._stop = self._bench.button(
            "Cancel",
            "Stop the solver and keep the last shape",
            self._scene.work.cancel,
            disabled=True,
        )
        self._name = add_field(gui, "poses.name", "")
        actions = {
            "New": self.add,
            "Copy": self.duplicate,
            "Rename": self.rename,
            "Delete": self.delete,
        }
        hint = "New: holds a region and turns another. Rename: also in mixed states"
        self._bench.button_row("Pose", actions, hint)
        self.roles.add_panel()
        self.pulls.add_panel()

    def redraw(self, is_shown: bool) -> None:
        """Show the device's poses, and solve the chosen one if the part is shown."""
        device = self._bench.project.device
        self._update_controls(device)
        self._is_shown = is_shown
        if not is_shown or self._scene.body is None:
            self.pulls.clear()
            self._requested_pose = self._last_shape = None
            self._set_state("none", _NOT_MESHED if self._scene.body is None else "")
            return
        pose = self.pose
        self.pulls.show(pose)
        self.pulls.update_clicks()
        if pose is None:
            self._scene.show_rest()
            self._scene.show_grips(())
            has_regions = len(device.regions) > 1
            self._set_state("none", "There is no pose yet." if has_regions else _TOO_FEW_REGIONS)
            return
        if self._requested_pose != pose.name:
            self.centers = {}
        self._show_grips()
        self._request(pose, is_final=True)

    def choose(self, name: str | None) -> None:
        """Show a pose."""
        self.chosen = name
        self.redraw(True)

    def follow_grip(self, name: str, position: Float, rotation: Float, has_ended: bool) -> None:
        """Follow a gizmo; write the pose once the user releases it.

        Args:
            name: Name of the grip.
            position: Its position (3,) mm.
            rotation: Its rotation vector (3,) rad.
            has_ended: Whether the user has released it.
        """
        requested_at = time.perf_counter()
        pose, device = self.pose, self._bench.project.device
        if pose is None or self._scene.body is None:
            return
        moved = move_grip(pose, device, self._scene.points, name, position, rotation)
        self._is_dragging = not has_ended
        if not has_ended:
            self.pulls.draw(moved)
            self._request(moved, is_final=False, requested_at=requested_at)
        elif not self._apply(pose_edits(pose, moved)):
            self.redraw(True)

    def set_role(self, region: str, role: PoseRole) -> None:
        """Set what the pose does with a region; a region that is moved stays where it is."""
        pose, device = self.pose, self._bench.project.device
        if pose is None:
            return
        shift = [0.0, 0.0, 0.0]
        handle = next((h for h in pose.handles if h.region == region), None)
        if handle is not None and region in self.centers:
            rest = rotation_center(handle, device, self._scene.points)
            shift = np.round(self.centers[region] - rest, 1).tolist()
        is_same = role_of(pose, region) == role
        if is_same or not self._bench.apply(set_role(pose.name, region, role, shift)):
            self.redraw(True)

    def show_answer(self, request: PreviewRequest, answer: PreviewAnswer) -> None:
        """Show the shape of a request, or why there is none."""
        with self._bench.drawing_lock:
            is_current = self._is_shown and request.pose.name == self._requested_pose
            if not is_current or self._scene.body is None:
                return
            vertices, fine = answer.vertices, answer.fine
            if fine is not None and vertices is not None:
                self._last_shape = vertices
            elif vertices is None:  # a coarse shape may have been shown meanwhile
                vertices = self._last_shape
            if vertices is not None:
                self._scene.body.move(vertices)
                self.pulls.draw(request.pose if self._is_dragging else None)
            self._set_state(*_describe(request, answer))
            self._stop.disabled = fine is not None
            if fine is not None and fine.moved is not None and request.share == 1.0:
                self.centers = dict(fine.centers)
                if not self._is_dragging:
                    self._show_grips()

    def show_error(self, error: Exception) -> None:
        """Show why the body cannot have a pose; the last shape stays."""
        with self._bench.drawing_lock:
            self._stop.disabled = True
            code = error.code if isinstance(error, DefsenseError) else "task-failed"
            self.status.show(f"**{error}** The last shape stays.", code, error)
            if self._is_shown and self._last_shape is not None and self._scene.body is not None:
                self._scene.body.move(self._last_shape)

    def rename(self) -> None:
        """Rename the chosen pose to the name in the field."""
        name = self.new_name
        if self.chosen is None:
            self._show_no_pose()
        elif name != self.chosen:
            before, self.chosen = self.chosen, name
            if not self._bench.apply(rename_pose(before, name)):
                self.chosen = before

    def add(self) -> None:
        """Add a pose that holds a region and turns another that does not overlap it."""
        device = self._bench.project.device
        regions = list(device.regions)
        if len(regions) < 2:
            self._bench.status.show(_TOO_FEW_REGIONS, "regions-too-few")
            return
        held = device.outputs.anchor or regions[0]
        points = self._scene.points if self._scene.body is not None else np.zeros((0, 3))
        inside = points_in_regions(device.regions, points)
        others = [name for name in regions if name != held]
        separate = [name for name in others if not (inside[name] & inside[held]).any()]
        name = free_name("pose", [pose.name for pose in device.poses])
        self._add(name, add_pose(name, [held], (separate or others)[-1]))

    def duplicate(self) -> None:
        """Copy the chosen pose."""
        if self.chosen is None:
            self._show_no_pose()
            return
        name = free_name(self.chosen, [pose.name for pose in self._bench.project.device.poses])
        self._add(name, duplicate_pose(self.chosen, name))

    def delete(self) -> None:
        """Delete the chosen pose."""
        if self.chosen is None:
            self._show_no_pose()
        else:
            self._bench.apply(remove_pose(self.chosen))

    def solve_share(self, share: float) -> None:
        """Solve the chosen pose at a share of its ramp."""
        if self.pose is not None:
            self._request(self.pose, is_final=False, share=share)

    def _update_controls(self, device: Device) -> None:
        names = [pose.name for pose in device.poses]
        if self.chosen not in names:
            self.chosen = names[0] if names else None
        self._list.options = tuple(names) or (NONE,)
        self._list.value = self.chosen or NONE
        self._name.value = self.chosen or ""
        self.roles.show(device, self.pose)

    def _choose_from_list(self, name: str) -> None:
        with self._bench.drawing_lock:
            self.choose(None if name == NONE else name)

    def _add(self, name: str, edit: Edit) -> None:
        before, self.chosen = self.chosen, name
        if not self._bench.apply(edit):
            self.chosen = before

    def _apply(self, edits: list[Edit]) -> bool:
        return bool(edits) and all([self._bench.apply(edit) for edit in edits])

    def _request(
        self,
        pose: Pose,
        *,
        is_final: bool,
        share: float = 1.0,
        requested_at: float | None = None,
    ) -> None:
        if requested_at is None:
            requested_at = time.perf_counter()
        # After a drag a coarse shape would be a step back from the fine one that is shown.
        wants_coarse = self._requested_pose != pose.name or not is_final
        self._requested_pose = pose.name
        if share == 1.0:
            self._ramp.reset()
        device = self._bench.project.device
        self._scene.work.give(
            PreviewRequest(device, pose, share, is_final, wants_coarse, requested_at)
        )
        if self._stop.disabled:
            self._stop.disabled = False
        if is_final:
            self._set_state("solving", f"Solving `{pose.name}` ...")

    def _show_grips(self) -> None:
        pose = self.pose
        if pose is not None and self._scene.body is not None:
            device = self._bench.project.device
            self._scene.show_grips(pose_grips(pose, device, self._scene.points, self.centers))

    def _show_no_pose(self) -> None:
        self._bench.status.show("Choose a pose first.", "no-pose-chosen")

    def _set_state(self, state: ShapeState, text: str) -> None:
        self.status.show(text, state)


def _describe(request: PreviewRequest, answer: PreviewAnswer) -> tuple[ShapeState, str]:
    """Return the state and the description of a shape."""
    name, fine = request.pose.name, answer.fine
    if fine is None:
        return "coarse", "Coarse shape. The fine shape follows."
    if fine.is_cancelled:
        return "cancelled", "Cancelled. The last shape stays."
    if fine.moved is None:
        return "not-reached", f"**{unreached_message(name, fine.share)}** The last shape stays."
    if fine.problem:
        action = "Reduce its movement, or enlarge its regions."
        return "invalid", f"**`{name}`: {fine.problem}.** {action}"
    share = f" at {request.share:.0%}" if request.share < 1 else ""
    if request.is_final:
        return "checked", f"`{name}`{share}, as a build simulates it."
    return "solved", f"`{name}`{share}"
