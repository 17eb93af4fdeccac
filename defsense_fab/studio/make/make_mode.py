"""The mode that builds the device: its parts, their assembly, and the lists of materials."""

from __future__ import annotations

import html
from collections.abc import Callable
from typing import Any

from ...core.errors import DefsenseError
from ...workflow.build.build import first_outdated
from ...workflow.build.export import describe_changes, export, export_name
from ...workflow.build.recorded_options import recorded_options
from ...workflow.build.results import has_parts
from ...workflow.fabrication.assembly_guide import (
    AssemblyGuide,
    GuideStep,
    GuideTable,
    Note,
    assembly_guide,
)
from ..workbench.build_state import BuildState as BuildState
from ..workbench.controls import on_user
from ..workbench.latest_worker import LatestWorker
from ..workbench.mode import Mode
from ..workbench.page_texts import bullet_list, escape_cell, markdown_table
from ..workbench.workbench import Workbench
from .parts_scene import PartsScene, fly_to

_ALL_PARTS = "All parts"
_NOT_BUILT = "not built yet"
_TABLES = ("Cut list", "Bill of materials", "Print", "Checked before writing")
_MARK_COLOR, _MARK_RADIUS = (200, 30, 120), 0.02  # radius times the body's size
_MAX_COLUMNS = 5  # columns that fit into the panel
_BUILD_BUTTON = "*Build everything*"


class MakeMode(Mode):
    """Build the device in the background, and show its parts and the steps of their assembly.

    Attributes:
        guide: The assembly guide of the built device, or None.
        scene: The parts in the scene, or None.
        state: Which version of the device the parts belong to.
        step: Number of the shown step from 1, or 0 for all parts.
        marked_note: The note whose point is marked, or None.
        loading: Loads the last build.
        checking: Checks whether the parts are up to date.
        flying: Flies the cameras.
        exporting: Writes the zip.
    """

    label = "Make"
    hint = "Build the parts, see how to assemble them, and export everything."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.guide: AssemblyGuide | None = None
        self.scene: PartsScene | None = None
        self.state = BuildState(is_built=False)
        self.step = 0
        self.marked_note: Note | None = None
        self._note_handles: list[Any] = []
        self._mark: Any = None
        self.loading = LatestWorker(self._load, bench.status.show_error)
        self.checking = LatestWorker(self._check, bench.status.show_error)
        self.flying = LatestWorker(self._fly, bench.status.show_error)
        self.exporting = LatestWorker(self._export, bench.status.show_error)
        bench.on_build_started.append(self._show_cancel)

    def add_panel(self) -> None:
        bench, gui = self.bench, self.bench.server.gui
        self._state_text = gui.add_markdown("")
        bench.button(
            "Build everything",
            "Build the parts, the guide and the report, as `defsense build` does",
            lambda: bench.build("report"),
            color="blue",
        )
        self._cancel = bench.button(
            "Cancel",
            "Stop the build and keep the last one",
            bench.builds.cancel,
            visible=False,
            color="gray",
        )
        self._save = gui.add_button(
            "Export as a zip",
            hint="Save the parts, guide, report, cut list, design and body files in one file",
        )
        self._save.on_click(lambda event: self.export(event.client))
        self._steps = gui.add_dropdown("Step", (_ALL_PARTS,), hint="Choose a step of the guide")
        on_user(self._steps, lambda title: self.choose(self._steps.options.index(title)))
        self._turn = gui.add_button_group("Go to", ("Back", "Next"))
        self._turn.on_click(lambda _: self.go(1 if self._turn.value == "Next" else -1))
        self._explosion = gui.add_slider(
            "Exploded view", 0.0, 1.0, 0.01, 1.0, hint="Set the distance between the parts"
        )
        self._explosion.on_update(lambda _: self._explode())
        self._step_text = gui.add_markdown("")
        self._warnings = gui.add_folder("Warnings", expand_by_default=True)
        with self._warnings:
            self._no_warnings = gui.add_markdown("none")
        self._tables = {}
        for title in _TABLES:
            with gui.add_folder(title, expand_by_default=False):
                self._tables[title] = gui.add_markdown(_NOT_BUILT)

    def enter(self) -> None:
        self._draw()
        self.on_device_changed()

    def leave(self) -> None:
        if self.scene is not None:
            self.scene.hide()
        self._unmark()
        if self.bench.body is not None:
            self.bench.body.visible = True

    def on_build_loaded(self) -> None:
        self._cancel.visible = self.bench.builds.is_running
        self.loading.give(None)

    def on_device_changed(self) -> None:
        self.checking.give(None)

    def close(self) -> None:
        for worker in (self.loading, self.checking, self.flying, self.exporting):
            worker.close()

    def go(self, count: int) -> None:
        """Go forward by a number of steps, or back if it is negative."""
        last = 0 if self.guide is None else len(self.guide.steps)
        self.choose(min(max(self.step + count, 0), last))

    def choose(self, step: int) -> None:
        """Show a step of the guide, numbered from 1, or 0 for all parts."""
        with self.bench.drawing_lock:
            self.step = step
            self._unmark()
            self._steps.value = self._steps.options[step]
            self._draw()

    def set_explosion(self, share: float) -> None:
        """Set the share of the exploded view, from 0 (assembled) to 1."""
        self._explosion.value = share
        self._explode()

    def show_note(self, note: Note) -> None:
        """Fly to the point of a note and mark it."""
        self.flying.give(note)

    def export(self, client: Any) -> None:
        """Write the zip, and send it to a browser if one is given."""
        self.bench.status.show("Writing the zip ...", "exporting")
        self.exporting.give(client)

    def _show_cancel(self) -> None:
        self._cancel.visible = True

    def _explode(self) -> None:
        with self.bench.drawing_lock:
            if self.scene is not None and self.is_active:
                self.scene.explode(self._explosion.value)

    def _load(self, _: None) -> None:
        bench = self.bench
        device, build = bench.project.device, bench.results
        guide = None
        try:
            if has_parts(build):
                guide = assembly_guide(device, build)
        except (DefsenseError, OSError) as error:
            bench.status.show_error(error)
        with bench.drawing_lock:
            if self.scene is not None:
                self.scene.remove()
            self.guide, self.scene, self.step = guide, None, 0
            if guide is not None:
                wire_radius = device.fabrication.wire_diameter / 2
                self.scene = PartsScene(bench.server, guide, device.cord.diameter / 2, wire_radius)
            self._list_contents()
            self._draw()
        self.checking.give(None)

    def _check(self, _: None) -> None:
        device = self.bench.project.device
        folder, stage = self.bench.results.folder, first_outdated(device)
        changes = options = ""
        if stage is not None:
            changes = describe_changes(device, folder)
        else:
            options = str(recorded_options(device, folder))
        error = self.bench.build_error
        self.state = BuildState(
            is_built=self.guide is not None,
            outdated_stage=None if stage is None else stage.title,
            error=None if error is None else str(error),
            changes=changes,
            options=options,
        )
        self._state_text.content = state_text(self.state)

    def _list_contents(self) -> None:
        """List the steps, notes and tables of the built device."""
        gui, guide = self.bench.server.gui, self.guide
        steps = () if guide is None else guide.steps
        titles = (f"{number}. {step.title}" for number, step in enumerate(steps, start=1))
        self._steps.options = (_ALL_PARTS, *titles)
        self._steps.value = _ALL_PARTS
        for handle in self._note_handles:
            handle.remove()
        self._note_handles = []
        notes = () if guide is None else guide.notes
        self._no_warnings.visible = not notes
        with self._warnings:
            for note in notes:
                self._note_handles.append(gui.add_markdown(f"- {note.text}"))
                if note.point is not None:
                    button = gui.add_button("Show the place", hint="Fly all cameras to the place")
                    button.on_click(self._note_action(note))
                    self._note_handles.append(button)
        if guide is not None:
            for table in (*guide.tables, guide.checks):
                self._tables[table.title].content = table_text(table)
        else:
            for text in self._tables.values():
                text.content = _NOT_BUILT

    def _note_action(self, note: Note) -> Callable[[Any], None]:
        return lambda _: self.show_note(note)

    def _draw(self) -> None:
        guide, bench = self.guide, self.bench
        step = guide.steps[self.step - 1] if guide is not None and self.step else None
        self._step_text.content = "" if step is None else step_text(step, self.step)
        if not self.is_active:
            return
        if bench.body is not None:
            bench.body.visible = self.scene is None
        if self.scene is not None:
            self.scene.show(step, self.step - 1, self._explosion.value)

    def _fly(self, note: Note) -> None:
        bench = self.bench
        if note.point is None or bench.surface is None:
            return
        with bench.drawing_lock:
            self._unmark()
            self.step = 0
            self._steps.value, self._explosion.value = _ALL_PARTS, 0.0
            self._draw()
            if self.scene is not None and self.is_active:
                self.scene.fade()
            self.marked_note = note
            self._mark = bench.server.scene.add_icosphere(
                "/place",
                _MARK_RADIUS * bench.size,
                color=_MARK_COLOR,
                position=note.point,
            )
        fly_to(bench.server, note.point, bench.surface.bounds.mean(axis=0), bench.size)

    def _unmark(self) -> None:
        if self._mark is not None:
            self._mark.remove()
            self._mark = self.marked_note = None

    def _export(self, client: Any) -> None:
        device = self.bench.project.device
        path = device.source / export_name(device)
        names = export(device, path)
        self.bench.status.show(f"Wrote {len(names)} files to {path}", "exported")
        if client is not None:
            client.send_file_download(path.name, path.read_bytes(), save_immediately=True)


def step_text(step: GuideStep, number: int) -> str:
    """Return a step of the guide in markdown.

    Args:
        step: The step.
        number: Its number in the guide, from 1.
    """
    return f"### {number}. {escape_cell(step.title)}\n{bullet_list(map(escape_cell, step.lines))}"


def table_text(table: GuideTable) -> str:
    """Return a table of the guide in markdown; a wide table is transposed."""
    if not table.rows:
        return "no entries"
    rows = [[escape_cell(cell) for cell in row] for row in (table.header, *table.rows)]
    if len(table.header) > _MAX_COLUMNS:
        rows = [list(column) for column in zip(*rows, strict=True)]
    return markdown_table(rows[0], rows[1:], "l")


def state_text(state: BuildState) -> str:
    """Return which version of the device the parts belong to, and what to do, in markdown."""
    failure = "" if state.error is None else f" The last build failed: {html.escape(state.error)}."
    if not state.is_built:
        return f"**The device is not built yet.**{failure} Press {_BUILD_BUTTON}."
    if state.outdated_stage is None:
        text = "The parts are up to date."
        if state.options:
            text += (
                f" Their plates were built with `{state.options}`; {_BUILD_BUTTON} uses the values"
                " of device.toml. To keep these options, set them there under [fabrication]."
            )
        return text
    changes = f" ({state.changes})" if state.changes else ""
    return (
        f"**The device has changed since the parts were built**{changes}. The first outdated stage"
        f" is '{state.outdated_stage}'.{failure} Press {_BUILD_BUTTON}; the parts stay until then."
    )
