"""Poses that the body's lowest modes propose: shown on the body, and written when taken."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit import TOMLDocument
from tomlkit.exceptions import TOMLKitError

from ...core.device.device_file import load_device
from ...core.errors import DeviceError
from ...mechanics.solver.linear_response import ProposedPose
from ...workflow.study.propose_poses import PoseSearch, as_toml, extend_text, find_poses
from ..edits.edit import Edit
from ..edits.edit import free_name
from ..workbench.background_job import BackgroundJob, JobReporter
from .poses_scene import PosesScene

NONE = "none"
_NO_REGION = "Make a region first, by which the body is held."


class SuggestionPart:
    """In a folder of the panel."""

    def __init__(self, scene: PosesScene) -> None:
        self._scene, self._bench = scene, scene.bench
        self._found: PoseSearch | None = None
        self._fixed = ""
        self._looking = BackgroundJob("search for modes", self._told, self._ended, self._came)
        self.taken: Callable[[str], None] = lambda _: None  # hears of a pose that was written

    def add_panel(self) -> None:
        """Its buttons and words, in the folder that is open."""
        gui, button = self._bench.server.gui, self._bench.button
        self._held = gui.add_dropdown("Held", (NONE,), hint="The region by which the body is held")
        button("Propose poses", "What a hand will do to the body: its lowest modes", self.look)
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._stop = button("Cancel the search", "Nothing changes", self.cancel, visible=False)
        self.words = gui.add_markdown("")
        self._list = gui.add_dropdown("Proposed", (NONE,), visible=False, hint="Shown on the body")
        self._list.on_update(lambda event: self._listed(event))
        self._take = button("Take it", "Write the pose", self.take, visible=False)
        self._all = button("Take all", "As `defsense modes --write`", self.take_all, visible=False)

    def redraw(self) -> None:
        """As the device is now."""
        regions = list(self._bench.project.device.regions)
        before = self._held.value
        self._held.options = tuple(regions) or (NONE,)
        self._held.value = before if before in regions else (regions or [NONE])[0]

    def on_build_loaded(self) -> None:
        """There is another mesh: what was proposed is of the one before."""
        self._know(None)

    def close(self) -> None:
        """End the search."""
        self._looking.close()

    def cancel(self) -> None:
        """End the search; what was found before stays."""
        self._looking.cancel()

    def look(self) -> None:
        """For poses with the chosen region held, beside the page."""
        region = self._held.value
        if region == NONE:
            self._bench.show_message(_NO_REGION)
        elif self._scene.body is None:
            self._bench.show_message("Mesh the body first.")
        elif self._bench.may_run_script(self.look):  # the mesh may have to be made anew
            self._searching(True)
            self._looking.begin(_look, self._bench.project.folder, region)

    def choose(self, name: str) -> None:
        """Show a proposed pose on the body."""
        pose = self._pose(name)
        if self._found is None or pose is None or self._scene.body is None:
            return
        self._list.value = name
        moved = self._found.shape(pose)[self._found.surface_nodes]
        if len(moved) == len(self._scene.points):
            self._scene.grips(())
            self._scene.body.move(self._scene.points + moved)
            self._bench.show_message(f"The mode of `{name}`, enlarged; take it to see the pose.")

    def take(self) -> str | None:
        """Write the chosen pose; its name, None where that is refused. States follow from all poses
        as long as the device does not name them, so that none are written."""
        pose = self._pose(self._list.value)
        if pose is None or self._found is None:
            self._bench.show_message("Look for poses, and choose one.")
            return None
        return self._write([pose], states=False)

    def take_all(self) -> str | None:
        """Write all, with the states by which cords are designed and judged; the first's name."""
        if self._found is None or not self._found.poses:
            self._bench.show_message("Look for poses first.")
            return None
        return self._write(self._found.poses, states=True)

    def _write(self, poses: Sequence[ProposedPose], *, states: bool) -> str | None:
        assert self._found is not None
        taken, named = [p.name for p in self._bench.project.device.poses], list[ProposedPose]()
        for pose in poses:
            named.append(replace(pose, name=free_name(pose.name, taken)))
            taken.append(named[-1].name)
        text = as_toml(named, self._fixed, self._found.region)
        if not states:
            added = tomlkit.parse(text)
            added.pop("states", None)
            text = tomlkit.dumps(added)
        told = ", ".join(f"`{p.name}`" for p in named)
        if not self._bench.apply(_taking(told, text)):
            return None
        with self._bench.drawing_lock:
            self.taken(named[0].name)
        return named[0].name

    def _searching(self, on: bool) -> None:
        self._bar.visible = self._stop.visible = on
        self._bar.value = 0.0
        if on:
            self.words.content = "looking for the body's lowest modes"

    def _told(self, share: float, told: str) -> None:
        self._bar.value = 100 * share
        self.words.content = told

    def _came(self, found: tuple[str, PoseSearch]) -> None:
        with self._bench.drawing_lock:
            self._fixed, known = found
            self._know(known)

    def _ended(self, problem: str | None) -> None:
        with self._bench.drawing_lock:
            self._searching(False)
            if problem is not None:
                self.words.content = f"**{problem}**"

    def _know(self, found: PoseSearch | None) -> None:
        self._found = found
        poses = () if found is None else found.poses
        self._list.options = tuple(p.name for p in poses) or (NONE,)
        for part in (self._list, self._take, self._all):
            part.visible = bool(poses)
        if found is None:
            self.words.content = ""
            return
        rows = [f"| {p.name} | {p.mode.frequency:.3g} Hz |" for p in poses]
        table = ["| pose | its mode |", "|---|---:|", *rows]
        self.words.content = "\n".join(table) if rows else "No mode is one that a hand can lead."
        if poses:
            self.choose(poses[0].name)

    def _pose(self, name: str) -> ProposedPose | None:
        poses = () if self._found is None else self._found.poses
        return next((p for p in poses if p.name == name), None)

    def _listed(self, event: Any) -> None:
        if event.client is not None:
            with self._bench.drawing_lock:
                self.choose(self._list.value)


def _look(teller: JobReporter, folder: Path, region: str) -> None:
    """In the other process."""

    def progress(stage: str, share: float, told: str) -> None:
        teller.progress(share, f"{stage}: {told}")

    teller.found((region, find_poses(load_device(folder, complete=False), region, 8, progress)))


def _taking(told: str, text: str) -> Edit:
    def change(document: TOMLDocument) -> TOMLDocument:
        try:
            return tomlkit.parse(extend_text(tomlkit.dumps(document), text))
        except (TOMLKitError, tomllib.TOMLDecodeError) as error:
            raise DeviceError(f"device.toml: the poses cannot be added to it ({error})") from None

    return Edit(f"take {told}", change)
