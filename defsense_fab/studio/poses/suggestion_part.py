"""Poses proposed from the body's lowest vibration modes: shown on the body, then written."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit import TOMLDocument
from tomlkit.exceptions import TOMLKitError

from ...core.device.device_file import DEVICE, load_device
from ...core.errors import DefsenseError, DeviceError
from ...mechanics.solver.linear_response import ProposedPose
from ...workflow.study.propose_poses import PoseSearch, as_toml, extend_text, find_poses
from ..edits.edit import Edit, free_name
from ..workbench.background_job import BackgroundJob, JobReporter
from .poses_scene import PosesScene

NONE = "none"
_NO_REGION = "Add a region by which the body is held first."


class SuggestionPart:
    """Search for poses, show them and write them.

    Args:
        scene: The body and its gizmos.

    Attributes:
        job: The search in the background.
        search_result: The poses that were found last, or None.
        error: Error of the last search, or None.
        on_taken: Called with the name of a pose that was written.
    """

    def __init__(self, scene: PosesScene) -> None:
        self._scene, self._bench = scene, scene.bench
        self.search_result: PoseSearch | None = None
        self._fixed = ""
        self.job = BackgroundJob(
            "search for modes", self._show_progress, self._end_search, self._show_result
        )
        self.error: DefsenseError | None = None
        self.on_taken: Callable[[str], None] = lambda _: None

    def add_panel(self) -> None:
        """Add the controls to the open folder of the panel."""
        gui, button = self._bench.server.gui, self._bench.button
        self._held = gui.add_dropdown(
            "Held region", (NONE,), hint="Choose the region by which the body is held"
        )
        button("Propose poses", "Search for the lowest vibration modes of the body", self.search)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._stop = button(
            "Cancel the search", "Keep the poses that were found before", self.cancel, visible=False
        )
        self.words = gui.add_markdown("")
        self._list = gui.add_dropdown(
            "Proposed pose", (NONE,), visible=False, hint="Choose a pose to show on the body"
        )
        self._list.on_update(lambda event: self._listed(event))
        self._take = button(
            "Take the pose", "Write the pose to device.toml", self.take, visible=False
        )
        self._all = button(
            "Take all",
            "Write all poses with their states, as `defsense modes --write`",
            self.take_all,
            visible=False,
        )

    def redraw(self) -> None:
        """Show the regions of the device."""
        regions = list(self._bench.project.device.regions)
        before = self._held.value
        self._held.options = tuple(regions) or (NONE,)
        self._held.value = before if before in regions else (regions or [NONE])[0]

    def on_build_loaded(self) -> None:
        """Remove the proposed poses, which belong to the previous mesh."""
        self.show(None)

    def close(self) -> None:
        """End the search."""
        self.job.close()

    def cancel(self) -> None:
        """Cancel the search; poses that were found before stay."""
        self.job.cancel()

    def search(self, held: str | None = None) -> None:
        """Search in the background for poses with a region held, by default the chosen one."""
        region = held or self._held.value
        if region == NONE:
            self._bench.show_message(_NO_REGION, "no-region")
        elif self._scene.body is None:
            self._bench.show_message("Mesh the body first.", "not-meshed")
        elif self._bench.may_run_script(lambda: self.search(held)):  # to make an outdated mesh
            self._show_search(True)
            self.job.start(search_poses, self._bench.project.folder, region)

    def choose(self, name: str) -> None:
        """Show a proposed pose on the body, enlarged."""
        pose = self._pose(name)
        if self.search_result is None or pose is None or self._scene.body is None:
            return
        self._list.value = name
        moved = self.search_result.shape(pose)[self.search_result.surface_nodes]
        if len(moved) == len(self._scene.points):
            self._scene.grips(())
            self._scene.body.move(self._scene.points + moved)
            self._bench.show_message(f"The mode of `{name}`, enlarged. Take it to see the pose.")

    def take(self) -> str | None:
        """Write the chosen pose and return its name, or None on failure.

        No states are written: unless the device names states, they follow from all poses.
        """
        pose = self._pose(self._list.value)
        if pose is None or self.search_result is None:
            self._bench.show_message("Propose poses, then choose one.", "no-pose-chosen")
            return None
        return self._write([pose], states=False)

    def take_all(self) -> str | None:
        """Write all poses with their states. Return the first's name, or None on failure."""
        if self.search_result is None or not self.search_result.poses:
            self._bench.show_message("Propose poses first.", "no-pose-chosen")
            return None
        return self._write(self.search_result.poses, states=True)

    def _write(self, poses: Sequence[ProposedPose], *, states: bool) -> str | None:
        assert self.search_result is not None
        taken, named = [p.name for p in self._bench.project.device.poses], list[ProposedPose]()
        for pose in poses:
            named.append(replace(pose, name=free_name(pose.name, taken)))
            taken.append(named[-1].name)
        text = as_toml(named, self._fixed, self.search_result.region)
        if not states:
            added = tomlkit.parse(text)
            added.pop("states", None)
            text = tomlkit.dumps(added)
        names = ", ".join(f"`{p.name}`" for p in named)
        if not self._bench.apply(_take_edit(names, text)):
            return None
        with self._bench.drawing_lock:
            self.on_taken(named[0].name)
        return named[0].name

    def _show_search(self, on: bool) -> None:
        self._bar.visible = self._stop.visible = on
        self._bar.value = 0.0
        if on:
            self.error = None
            self.words.content = "searching for the lowest modes of the body"

    def _show_progress(self, share: float, message: str) -> None:
        self._bar.value = 100 * share
        self.words.content = message

    def _show_result(self, result: tuple[str, PoseSearch]) -> None:
        with self._bench.drawing_lock:
            self._fixed, search = result
            self.show(search, self._fixed)

    def _end_search(self, error: DefsenseError | None, _: None) -> None:
        with self._bench.drawing_lock:
            self._show_search(False)
            self.error = error
            if error is not None:
                self.words.content = f"**{error}**"

    def show(self, search: PoseSearch | None, held: str = "") -> None:
        """List the poses of a search with the region `held`; None removes all."""
        self.search_result, self._fixed = search, held
        poses = () if search is None else search.poses
        self._list.options = tuple(p.name for p in poses) or (NONE,)
        for part in (self._list, self._take, self._all):
            part.visible = bool(poses)
        if search is None:
            self.words.content = ""
            return
        rows = [f"| {p.name} | {p.mode.frequency:.3g} Hz |" for p in poses]
        table = ["| Pose | Frequency |", "|---|---:|", *rows]
        self.words.content = (
            "\n".join(table) if rows else "The search found no mode that a hand can lead."
        )
        if poses:
            self.choose(poses[0].name)

    def _pose(self, name: str) -> ProposedPose | None:
        poses = () if self.search_result is None else self.search_result.poses
        return next((p for p in poses if p.name == name), None)

    def _listed(self, event: Any) -> None:
        if event.client is not None:
            with self._bench.drawing_lock:
                self.choose(self._list.value)


def search_poses(reporter: JobReporter, folder: Path, region: str) -> None:
    """Search for poses of the device in `folder`; run this in a BackgroundJob."""
    device = load_device(folder, complete=False)
    reporter.item((region, find_poses(device, region, 8, reporter.stage_progress)))


def _take_edit(names: str, text: str) -> Edit:
    def change(document: TOMLDocument) -> TOMLDocument:
        try:
            return tomlkit.parse(extend_text(tomlkit.dumps(document), text))
        except (TOMLKitError, tomllib.TOMLDecodeError) as error:
            raise DeviceError(
                f"the poses cannot be added ({error})", code="edit-not-possible", where=DEVICE
            ) from None

    return Edit(f"take {names}", change)
