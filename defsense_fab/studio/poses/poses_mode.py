"""The mode in which regions are chosen and poses made by hand, their shape following."""

from __future__ import annotations

from typing import Any

from ...optimize.prediction.pose_preview import PosePreview, PreviewedPose
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .pose_part import PosePart
from .poses_scene import PosesScene
from .preview_work import Answer, PreviewWork, Wanted
from .ramp_part import RampPart
from .region_part import RegionPart
from .suggestion_part import SuggestionPart

POSES, REGIONS = "Poses", "Regions"
_FIRST = (
    "The body has no mesh yet. **Mesh the body**: then its regions can be chosen, and poses solved"
    " as they are changed."
)


class PosesMode(Mode):
    """Either regions or poses are shown, with gizmos on what is chosen."""

    label = "Poses"
    hint = "Choose regions of the body, hold some and move others; its shape follows."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.work = PreviewWork(self._answered, self._solved, self._failed)
        self.scene = PosesScene(bench, self.work)
        self.ramp = RampPart(self.scene)
        self.regions, self.poses = RegionPart(self.scene), PosePart(self.scene, self.ramp)
        self.suggestions = SuggestionPart(self.scene)
        self.ramp.seek, self.ramp.pose = self.poses.seek_share, lambda: self.poses.pose
        self.suggestions.on_taken = self.poses.choose
        self.scene.clicked = self.poses.pulls.clicked
        self._entered = False
        self.part = POSES  # or REGIONS, whichever is shown

    def add_panel(self) -> None:
        gui, bench = self.bench.server.gui, self.bench
        self._first = gui.add_markdown(_FIRST)
        self._mesh = bench.button("Mesh the body", "Beside the page", lambda: bench.build("mesh"))
        self._part = gui.add_button_group("Show", (POSES, REGIONS), hint="What gizmos move")
        self._part.on_click(lambda event: self._chosen(event))
        self._folders = {}
        for name, parts in (
            (REGIONS, (self.regions,)), (POSES, (self.poses, self.ramp)),
        ):  # fmt: skip
            self._folders[name] = gui.add_folder(name)
            with self._folders[name]:
                for part in parts:
                    part.add_panel()
        with gui.add_folder("Proposed poses", expand_by_default=False) as self._proposed:
            self.suggestions.add_panel()

    def enter(self) -> None:
        self._entered = True
        bench = self.bench
        bench.server.scene.on_rect_select(modifier="shift")(self._selected)
        self.scene.show(True)
        self._redraw()

    def leave(self) -> None:
        self._entered = False
        self.bench.server.scene.remove_rect_select_callback(self._selected)
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
        """POSES or REGIONS."""
        with self.bench.drawing_lock:
            self._part.value = self.part = part
            self.ramp.stop()
            self.scene.grips(())
            self._redraw()

    def _chosen(self, event: Any) -> None:
        if event.client is not None:
            self.show(self._part.value)

    def _redraw(self) -> None:
        meshed, poses = self.scene.body is not None, self.part == POSES
        self._first.visible = not meshed
        self._mesh.label = "Mesh the body again" if meshed else "Mesh the body"
        for name, folder in self._folders.items():
            folder.visible = meshed and name == self.part
        self._proposed.visible = meshed and poses
        self.scene.moved = self.poses.moved if poses else self.regions.moved
        self.regions.redraw(self._entered and not poses)
        self.poses.redraw(self._entered and poses)
        self.suggestions.redraw()

    def _selected(self, event: Any) -> None:
        """A rectangle was drawn: regions are shown from then on."""
        if self.part != REGIONS:
            self.show(REGIONS)
        self.regions.selected(event)

    def _answered(self, wanted: Wanted, answer: Answer) -> None:
        self.poses.answered(wanted, answer)

    def _solved(self, preview: PosePreview, wanted: Wanted, found: PreviewedPose) -> None:
        self.ramp.solved(preview, wanted, found)

    def _failed(self, error: Exception) -> None:
        self.poses.failed(error)
