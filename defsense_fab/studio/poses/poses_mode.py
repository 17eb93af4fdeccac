"""The mode in which the user defines regions and poses, and the body follows."""

from __future__ import annotations

from typing import Any

from ..workbench.controls import on_user
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .pose_part import PosePart
from .poses_scene import PosesScene
from .preview_work import PreviewWork
from .ramp_part import RampPart
from .region_part import RegionPart
from .suggestion_part import SuggestionPart

POSES, REGIONS = "Poses", "Regions"
_MESH_FIRST = (
    "The body has no mesh yet. Press **Mesh the body** to define regions and to solve poses while"
    " you change them."
)
_MESH_LABEL, _MESH_AGAIN_LABEL = "Mesh the body", "Mesh the body again"


class PosesMode(Mode):
    """Show either the regions or the poses, with gizmos on the chosen one.

    Attributes:
        work: Solves poses on a thread.
        scene: The body and its gizmos.
        ramp: The ramp of the chosen pose.
        regions: The regions.
        poses: The poses.
        suggestions: Poses that are proposed from the body's vibration modes.
        part: The part that is shown: `POSES` or `REGIONS`.
    """

    label = "Poses"
    hint = "Define regions of the body, hold some and move others. The body follows."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.work = PreviewWork(
            lambda request, answer: self.poses.show_answer(request, answer),
            lambda preview, request, solved: self.ramp.follow(preview, request, solved),
            lambda error: self.poses.show_error(error),
        )
        self.scene = PosesScene(bench, self.work)
        self.ramp = RampPart(self.scene)
        self.regions, self.poses = RegionPart(self.scene), PosePart(self.scene, self.ramp)
        self.suggestions = SuggestionPart(self.scene)
        self.ramp.solve_share, self.ramp.pose = self.poses.solve_share, lambda: self.poses.pose
        self.suggestions.on_added = self.poses.choose
        self.scene.on_click = self.poses.pulls.click
        self.part = POSES

    @property
    def is_meshed(self) -> bool:
        """Whether the body has a mesh; without one, both parts are hidden."""
        return self.scene.body is not None

    def add_panel(self) -> None:
        gui, bench = self.bench.server.gui, self.bench
        self._mesh_first = gui.add_markdown(_MESH_FIRST)
        self._mesh = bench.button(
            _MESH_LABEL, "Make the mesh in the background", lambda: bench.build("mesh")
        )
        self._part = gui.add_button_group(
            "Show", (POSES, REGIONS), hint="Choose what the gizmos move"
        )
        on_user(self._part, self.show)
        self._folders = {}
        for name, parts in ((REGIONS, (self.regions,)), (POSES, (self.poses, self.ramp))):
            self._folders[name] = gui.add_folder(name)
            with self._folders[name]:
                for part in parts:
                    part.add_panel()
        with gui.add_folder("Proposed poses", expand_by_default=False) as self._suggestion_folder:
            self.suggestions.add_panel()

    def enter(self) -> None:
        self.bench.server.scene.on_rect_select(modifier="shift")(self.follow_rectangle)
        self.scene.show(True)
        self._redraw()

    def leave(self) -> None:
        self.bench.server.scene.remove_rect_select_callback(self.follow_rectangle)
        self.ramp.stop()
        self.work.cancel()
        self.poses.pulls.clear()
        self.scene.show(False)

    def on_build_loaded(self) -> None:
        self.ramp.stop()
        self.scene.load()
        self.suggestions.on_build_loaded()

    def on_device_changed(self) -> None:
        self.scene.color_regions()
        self._redraw()

    def close(self) -> None:
        self.ramp.stop()
        self.suggestions.close()
        self.work.close()

    def show(self, part: str) -> None:
        """Show the part `POSES` or `REGIONS`."""
        with self.bench.drawing_lock:
            self._part.value = self.part = part
            self.ramp.stop()
            self.scene.show_grips(())
            self._redraw()

    def follow_rectangle(self, event: Any) -> None:
        """Show the regions, and fit one to a rectangle that the user has drawn."""
        if self.part != REGIONS:
            self.show(REGIONS)
        self.regions.follow_rectangle(event)

    def _redraw(self) -> None:
        shows_poses = self.part == POSES
        self._mesh_first.visible = not self.is_meshed
        self._mesh.label = _MESH_AGAIN_LABEL if self.is_meshed else _MESH_LABEL
        for name, folder in self._folders.items():
            folder.visible = self.is_meshed and name == self.part
        self._suggestion_folder.visible = self.is_meshed and shows_poses
        self.scene.on_grip = self.poses.follow_grip if shows_poses else self.regions.follow_grip
        self.regions.redraw(self.is_active and not shows_poses)
        self.poses.redraw(self.is_active and shows_poses)
        self.suggestions.redraw()
