"""Poses proposed from the body's lowest vibration modes: shown on the body, then written."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...core.errors import DefsenseError
from ...workflow.study.propose_poses import PoseSearch, ProposedPose
from ..workbench.background_job import BackgroundJob
from ..workbench.controls import NONE, on_user
from ..workbench.page_texts import StatusText, escape_cell, markdown_table
from .pose_search import add_proposed, search_poses
from .poses_scene import PosesScene

_NO_REGION = "Add the region that holds the body first."


class SuggestionPart:
    """Propose poses, show them and add them to the device.

    Args:
        scene: The body and its gizmos.

    Attributes:
        job: The search in the background.
        result: The last search, or None.
        status: What the search does or has found.
        on_added: Called with the name of a pose that was added to the device.
    """

    def __init__(self, scene: PosesScene) -> None:
        self._scene, self._bench = scene, scene.bench
        self.result: PoseSearch | None = None
        self._held_region = ""
        self.job = BackgroundJob(
            "search for modes", self._show_progress, self._end_search, self._show_result
        )
        self.status = StatusText()
        self.on_added: Callable[[str], None] = lambda _: None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the proposed poses."""
        return () if self.result is None else tuple(pose.name for pose in self.result.poses)

    @property
    def chosen(self) -> str:
        """Name of the chosen pose."""
        return str(self._list.value)

    @chosen.setter
    def chosen(self, name: str) -> None:
        self._list.value = name

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, button = self._bench.server.gui, self._bench.button
        self._held = gui.add_dropdown(
            "Held region", (NONE,), hint="Choose the region that holds the body"
        )
        button("Propose poses", "Search for the lowest vibration modes of the body", self.search)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._stop = button(
            "Cancel the search", "Keep the poses of the last search", self.job.cancel, visible=False
        )
        self.status.add_panel(gui)
        self._list = gui.add_dropdown(
            "Proposed pose", (NONE,), visible=False, hint="Choose a pose to show on the body"
        )
        on_user(self._list, self._choose_from_list)
        self._add_button = button(
            "Add the pose", "Write the pose to device.toml", self.add, visible=False
        )
        self._add_all_button = button(
            "Add all poses",
            "Write all poses and their states to device.toml, like `defsense modes --write`",
            self.add_all,
            visible=False,
        )

    def redraw(self) -> None:
        """Show the regions of the device."""
        self._held.options = tuple(self._bench.project.device.regions) or (NONE,)

    def on_build_loaded(self) -> None:
        """Remove the proposed poses, which belong to the previous mesh."""
        self.show(None)

    def close(self) -> None:
        """End the search."""
        self.job.close()

    def search(self, held: str | None = None) -> None:
        """Search in the background for poses.

        Args:
            held: Region that holds the body; by default the one that the user has chosen.
        """
        region = held or self._held.value
        if region == NONE:
            self._bench.status.show(_NO_REGION, "no-region")
        elif self._scene.body is None:
            self._bench.status.show("Mesh the body first.", "not-meshed")
        elif self._bench.may_run_script(lambda: self.search(held)):  # to make the mesh again
            self._show_search(True)
            self.job.start(search_poses, self._bench.project.folder, region)

    def choose(self, name: str) -> None:
        """Show a proposed pose on the body, enlarged."""
        pose = self._pose(name)
        if self.result is None or pose is None or self._scene.body is None:
            return
        self._list.value = name
        moved = self.result.shape(pose)[self.result.surface_nodes]
        if len(moved) == len(self._scene.points):
            self._scene.show_grips(())
            self._scene.body.move(self._scene.points + moved)
            self._bench.status.show(
                f"The mode of `{name}`, enlarged. Add it to see the pose.", "mode-shown"
            )

    def add(self) -> str | None:
        """Add the chosen pose to the device and return its name, or None on failure.

        No states are added: unless the device defines states, they follow from all poses.
        """
        pose = self._pose(self._list.value)
        if pose is None or self.result is None:
            self._bench.status.show("Propose poses, then choose one.", "no-pose-chosen")
            return None
        return self._write([pose], has_states=False)

    def add_all(self) -> str | None:
        """Add all poses and their states, and return the first name, or None on failure."""
        if self.result is None or not self.result.poses:
            self._bench.status.show("Propose poses first.", "no-pose-chosen")
            return None
        return self._write(self.result.poses, has_states=True)

    def _write(self, poses: Sequence[ProposedPose], *, has_states: bool) -> str | None:
        assert self.result is not None
        used_names = [p.name for p in self._bench.project.device.poses]
        names, edit = add_proposed(
            self.result, poses, self._held_region, used_names, has_states=has_states
        )
        if not self._bench.apply(edit):
            return None
        with self._bench.drawing_lock:
            self.on_added(names[0])
        return names[0]

    def _show_search(self, is_running: bool) -> None:
        self._bar.visible = self._stop.visible = is_running
        self._bar.value = 0.0
        if is_running:
            self.status.show("Searching for the lowest modes of the body ...", "searching")

    def _show_progress(self, share: float, message: str) -> None:
        self._bar.value = 100 * share
        self.status.show(message, "searching")

    def _show_result(self, result: tuple[str, PoseSearch]) -> None:
        with self._bench.drawing_lock:
            self._held_region, search = result
            self.show(search, self._held_region)

    def _end_search(self, error: DefsenseError | None, _: None) -> None:
        with self._bench.drawing_lock:
            self._show_search(False)
            if error is not None:
                self.status.show_error(error)

    def show(self, search: PoseSearch | None, held: str = "") -> None:
        """List the poses of a search, or none.

        Args:
            search: The search.
            held: Region that held the body.
        """
        self.result, self._held_region = search, held
        poses = () if search is None else search.poses
        self._list.options = tuple(p.name for p in poses) or (NONE,)
        for control in (self._list, self._add_button, self._add_all_button):
            control.visible = bool(poses)
        if search is None:
            self.status.show("")
            return
        rows = [[escape_cell(p.name), f"{p.mode.frequency:.3g} Hz"] for p in poses]
        if rows:
            self.status.show(markdown_table(["Pose", "Frequency"], rows))
        else:
            self.status.show("No mode was found that a moved region can follow.", "no-mode")
        if poses:
            self.choose(poses[0].name)

    def _pose(self, name: str) -> ProposedPose | None:
        poses = () if self.result is None else self.result.poses
        return next((p for p in poses if p.name == name), None)

    def _choose_from_list(self, name: str) -> None:
        with self._bench.drawing_lock:
            self.choose(name)
