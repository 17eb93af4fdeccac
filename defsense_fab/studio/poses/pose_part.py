"""Poses: listed, changed by hand, their shape following."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device, Pose
from ...mechanics.solver.load_stepping import Status
from ...optimize.prediction.pose_preview import unreached_message
from ..edits.edit import Edit, free_name
from ..edits.poses import add_pose, duplicate_pose, remove_pose, rename_pose, set_role, shift_handle
from ..workbench.workbench import Workbench
from .gizmos import center, edits_of, grips_of, with_grip
from .poses_scene import PosesScene
from .preview_work import Answer, Wanted
from .pull_list import PullList
from .ramp_part import RampPart

# What a pose does with each region: a drop-down each.

FREE, HELD, TURNED, MOVED = "left alone", "held", "turned, its place free", "turned and shifted"
ROLES = (FREE, HELD, TURNED, MOVED)


def role_of(pose: Pose, region: str) -> str:
    """One of ROLES."""
    if region in pose.fixed:
        return HELD
    for handle in pose.handles:
        if handle.region == region:
            return TURNED if np.isnan(handle.translation).any() else MOVED
    return FREE


def role_edits(pose: Pose, region: str, role: str, shift: list[float]) -> list[Edit]:
    """What is to be written for a role; `shift` (3,) mm is where a region lies that is moved from
    now on, so that nothing jumps."""
    if role == role_of(pose, region):
        return []
    if role in (FREE, HELD):
        return [set_role(pose.name, region, "held" if role == HELD else "free")]
    out = []
    if role_of(pose, region) in (FREE, HELD):
        out.append(set_role(pose.name, region, "moved"))
        if role == TURNED:  # which it begins with
            return out
    out.append(shift_handle(pose.name, region, "free" if role == TURNED else shift))
    return out


class RoleList:
    """In a folder of the panel. `chosen` hears of a region and its role."""

    def __init__(self, bench: Workbench, chosen: Any) -> None:
        self._bench, self._chosen = bench, chosen
        self._lists: dict[str, Any] = {}

    def add_panel(self) -> None:
        """In the folder that is open."""
        self._folder = self._bench.server.gui.add_folder("What it does with regions")

    def show(self, device: Device, pose: Pose | None) -> None:
        """The roles that a pose has now."""
        regions = list(device.regions)
        if list(self._lists) != regions:
            for made in self._lists.values():
                made.remove()
            with self._folder:
                self._lists = {name: self._add(name) for name in regions}
        self._folder.visible = pose is not None
        if pose is not None:
            for name, made in self._lists.items():
                made.value = role_of(pose, name)

    def _add(self, region: str) -> Any:
        made = self._bench.server.gui.add_dropdown(
            region, ROLES, hint="Moved regions have a gizmo: rings turn them, arrows shift them"
        )

        def updated(event: Any) -> None:
            if event.client is not None:
                self._chosen(region, made.value)

        made.on_update(updated)
        return made


NONE = "none"
_NO_BODY = "Mesh the body first: poses are solved on it."
_FIRST = "Make two regions first, one to hold and one to move."


class PosePart:
    """In the panel of the mode."""

    def __init__(self, scene: PosesScene, ramp: RampPart) -> None:
        self._scene, self._bench, self._ramp = scene, scene.bench, ramp
        self.chosen: str | None = None
        self.roles, self.pulls = RoleList(scene.bench, self.set_role), PullList(scene)
        self._shown = self._filling = self._dragging = False
        self._posed: str | None = None  # the pose that was asked for last
        self._centers: dict[str, Float] = {}
        self._good: Float | None = None  # the vertices (v, 3) mm of the last fine shape

    def add_panel(self) -> None:
        """Its buttons and words, in the folder that is open."""
        gui = self._bench.server.gui
        self._list = gui.add_dropdown("Pose", (NONE,), hint="Its gizmos can be dragged")
        self._list.on_update(lambda event: self._listed(event))
        self.words = gui.add_markdown(_NO_BODY)
        self._stop = self._bench.button(
            "Cancel", "The last shape stays", self._scene.work.cancel, disabled=True
        )
        self._name = gui.add_text("Name", "", hint="Letters, digits, - and _: it names files")
        self._bench.button_row("Pose", {
            "New": self.add, "Copy": self.duplicate, "Rename": self.rename, "Delete": self.delete,
        }, "A new one holds a region and turns another; mixed states follow names")  # fmt: skip
        self.roles.add_panel()
        self.pulls.add_panel()

    def redraw(self, shown: bool) -> None:
        """As the device is now; its shape is sought where the part is `shown`."""
        device = self._bench.project.device
        names = [p.name for p in device.poses]
        if self.chosen not in names:
            self.chosen = names[0] if names else None
        self._filling = True
        self._list.options = tuple(names) or (NONE,)
        self._list.value = self.chosen or NONE
        self._name.value = self.chosen or ""
        pose = self.pose
        self.roles.show(device, pose)
        self._filling = False
        self._shown = shown
        if not shown or self._scene.body is None:
            self.pulls.clear()
            self._posed = self._good = None
            self.words.content = _NO_BODY if self._scene.body is None else ""
            return
        self.pulls.show(pose)
        self.pulls.listen()
        if pose is None:
            self._scene.rest()
            self._scene.grips(())
            self.words.content = "There is no pose yet." if len(device.regions) > 1 else _FIRST
            return
        if self._posed != pose.name:
            self._centers = {}
        self._place_grips()
        self._seek(pose, check=True)

    @property
    def pose(self) -> Pose | None:
        """The chosen one, as the device has it."""
        poses = self._bench.project.device.poses
        return next((p for p in poses if p.name == self.chosen), None)

    def choose(self, name: str | None) -> None:
        """Show a pose."""
        self.chosen = name
        self.redraw(True)

    def moved(self, name: str, position: Float, rotation: Float, ended: bool) -> None:
        """A hand has a gizmo; what it did is written once it lets go."""
        asked = time.perf_counter()
        pose, device = self.pose, self._bench.project.device
        if pose is None or self._scene.body is None:
            return
        new = with_grip(pose, device, self._scene.points, name, position, rotation)
        self._dragging = not ended
        if not ended:
            self.pulls.draw(new)
            self._seek(new, check=False, asked=asked)
        elif not self._write(edits_of(pose, new)):
            self.redraw(True)

    def set_role(self, region: str, role: str) -> None:
        """What the pose does with a region."""
        pose, device = self.pose, self._bench.project.device
        if pose is None:
            return
        shift = [0.0, 0.0, 0.0]
        handle = next((h for h in pose.handles if h.region == region), None)
        if handle is not None and region in self._centers:
            away = self._centers[region] - center(handle, device, self._scene.points)
            shift = np.round(away, 1).tolist()
        if not self._write(role_edits(pose, region, role, shift)):
            self.redraw(True)

    def answered(self, wanted: Wanted, answer: Answer) -> None:
        """The solver has a shape, or says why it has none."""
        with self._bench.drawing_lock:
            if not self._shown or wanted.pose.name != self._posed or self._scene.body is None:
                return
            vertices, found = answer.vertices, answer.found
            if found is not None and vertices is not None:
                self._good = vertices
            elif vertices is None:  # a coarse shape may have been shown on the way
                vertices = self._good
            if vertices is not None:
                self._scene.body.move(vertices)
                self.pulls.draw(wanted.pose if self._dragging else None)
            self.words.content = self._told(wanted, answer)
            self._stop.disabled = answer.found is not None
            if found is not None and found.moved is not None and wanted.share == 1.0:
                self._centers = dict(found.centers)
                if not self._dragging:
                    self._place_grips()

    def failed(self, error: Exception) -> None:
        """A pose that the body cannot have; the last shape stays."""
        with self._bench.drawing_lock:
            self._stop.disabled = True
            self.words.content = f"**{error}.** The last shape stays."
            if self._shown and self._good is not None and self._scene.body is not None:
                self._scene.body.move(self._good)

    def rename(self) -> None:
        """The chosen pose, to what is written in the field."""
        name = self._name.value.strip()
        if self.chosen is None:
            self._bench.show_message("Choose a pose first.", "no-pose-chosen")
        elif name != self.chosen:
            before, self.chosen = self.chosen, name
            if not self._bench.apply(rename_pose(before, name)):
                self.chosen = before

    def add(self) -> None:
        """One that holds the first region and turns another that does not overlap it."""
        device = self._bench.project.device
        regions = list(device.regions)
        if len(regions) < 2:
            self._bench.show_message(_FIRST, "regions-too-few")
            return
        held = device.outputs.anchor or regions[0]
        points = self._scene.points if self._scene.body is not None else np.zeros((0, 3))
        taken = device.regions[held].contains(points)
        others = [n for n in regions if n != held]
        apart = [n for n in others if not (device.regions[n].contains(points) & taken).any()]
        name = free_name("pose", [p.name for p in device.poses])
        self._take(name, add_pose(name, [held], (apart or others)[-1]))

    def duplicate(self) -> None:
        """The chosen pose."""
        if self.chosen is None:
            self._bench.show_message("Choose a pose first.", "no-pose-chosen")
            return
        names = [p.name for p in self._bench.project.device.poses]
        name = free_name(self.chosen, names)
        self._take(name, duplicate_pose(self.chosen, name))

    def delete(self) -> None:
        """The chosen pose."""
        if self.chosen is None:
            self._bench.show_message("Choose a pose first.", "no-pose-chosen")
        else:
            self._bench.apply(remove_pose(self.chosen))

    def seek_share(self, share: float) -> None:
        """The chosen pose at a share of its ramp."""
        if self.pose is not None:
            self._seek(self.pose, check=False, share=share)

    def _take(self, name: str, edit: Edit) -> None:
        before, self.chosen = self.chosen, name
        if not self._bench.apply(edit):
            self.chosen = before

    def _write(self, edits: list[Edit]) -> bool:
        return bool(edits) and all([self._bench.apply(edit) for edit in edits])

    def _listed(self, event: Any) -> None:
        if event.client is None or self._filling:
            return
        with self._bench.drawing_lock:
            self.choose(None if self._list.value == NONE else self._list.value)

    def _seek(
        self, pose: Pose, *, check: bool, share: float = 1.0, asked: float | None = None
    ) -> None:
        asked = time.perf_counter() if asked is None else asked
        # A coarse shape would take a step back from the fine one that a hand has come to.
        quick = self._posed != pose.name or not check
        self._posed = pose.name
        if share == 1.0:
            self._ramp.reset()
        device = self._bench.project.device
        self._scene.work.give(Wanted(device, pose, share, check, quick, asked))
        if self._stop.disabled:
            self._stop.disabled = False
        if check:
            self.words.content = f"solving `{pose.name}`"

    def _place_grips(self) -> None:
        pose = self.pose
        if pose is not None and self._scene.body is not None:
            device = self._bench.project.device
            self._scene.grips(grips_of(pose, device, self._scene.points, self._centers))

    def _told(self, wanted: Wanted, answer: Answer) -> str:
        name, found = wanted.pose.name, answer.found
        if found is None:
            return "coarse shape; the fine one follows"
        if found.status is Status.CANCELLED:
            return "Cancelled: the last shape stays."
        if found.moved is None:
            return f"**{unreached_message(name, found.share)}** The last shape stays."
        if found.problem:
            return f"**`{name}`: {found.problem}.** Lower its movement, or enlarge its regions."
        at = f" at {wanted.share:.0%}" if wanted.share < 1 else ""
        return f"`{name}`{at}, as a build has it" if wanted.check else f"`{name}`{at}"
