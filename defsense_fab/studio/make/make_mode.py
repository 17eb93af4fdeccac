"""The mode in which the device is built: its parts, their assembly, what to cut and to buy."""

from __future__ import annotations

from typing import Any

from ...core.device.build_folder import build_folder
from ...core.errors import DefsenseError
from ...workflow.build.build import first_outdated
from ...workflow.build.export import describe_changes, export, export_name
from ...workflow.build.options import describe_options, recorded_options
from ..workbench.latest_worker import LatestWorker
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .built_device import BuiltDevice, Note, load_built
from .parts_scene import fly
from .built_device import state_words, step_words, table_words
from .parts_scene import PartsScene

_ALL = "All parts"
_MARK = (200, 30, 120)


class MakeMode(Mode):
    """Builds run beside the page; their parts are shown apart, and put together step by step."""

    label = "Make"
    hint = "Build the parts, see how they go together, and take all along."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.device: BuiltDevice | None = None
        self._scene: PartsScene | None = None
        self._step, self._entered = 0, False
        self._notes: list[Any] = []
        bench.on_build_started.append(self._begun)
        self._mark: Any = None
        self.loading = LatestWorker(self._load, bench.show_error)
        self.checking = LatestWorker(self._check, bench.show_error)
        self.flying = LatestWorker(self._fly, bench.show_error)
        self.exporting = LatestWorker(self._export, bench.show_error)

    def add_panel(self) -> None:
        bench, gui = self.bench, self.bench.server.gui
        self._state = gui.add_markdown("")
        bench.button("Build everything", "Parts, guide, report, as 'defsense build'",
                     lambda: bench.build("report"), color="blue")  # fmt: skip
        self._cancel = bench.button(
            "Cancel", "The last build stays", bench.builds.cancel, visible=False, color="gray"
        )
        self._save = gui.add_button(
            "Export as a zip",
            hint="Parts, guide, report, cut list, the design and the body's files",
        )
        self._save.on_click(lambda event: self.export(event.client))
        self._steps = gui.add_dropdown("Step", (_ALL,), hint="As the guide has them")
        self._steps.on_update(lambda event: self._listed(event))
        self._turn = gui.add_button_group("Go", ("Back", "Next"))
        self._turn.on_click(lambda _: self.go(1 if self._turn.value == "Next" else -1))
        self._apart = gui.add_slider("Apart", 0.0, 1.0, 0.01, 1.0, hint="How far the parts are")
        self._apart.on_update(lambda _: self._slid())
        self._words = gui.add_markdown("")
        self._warnings = gui.add_folder("Warnings", expand_by_default=True)
        with self._warnings:
            self._none = gui.add_markdown("none")
        self._tables = {}
        for title in ("Cut list", "Bill of materials", "Print", "Checked before writing"):
            with gui.add_folder(title, expand_by_default=False):
                self._tables[title] = gui.add_markdown("nothing is built yet")

    def enter(self) -> None:
        self._entered = True
        self._draw()
        self.on_device_changed()

    def leave(self) -> None:
        self._entered = False
        if self._scene is not None:
            self._scene.hide()
        self._unmark()
        if self.bench.body is not None:
            self.bench.body.visible = True

    def on_build_loaded(self) -> None:
        self._cancel.visible = self.bench.builds.running
        self.loading.give(None)

    def on_device_changed(self) -> None:
        self.checking.give(None)

    def close(self) -> None:
        for worker in (self.loading, self.checking, self.flying, self.exporting):
            worker.close()

    def go(self, by: int) -> None:
        """To a step after or before this one."""
        count = 0 if self.device is None else len(self.device.steps)
        self.choose(min(max(self._step + by, 0), count))

    def choose(self, step: int) -> None:
        """A step of the guide from 1 on, or 0 for all parts."""
        with self.bench.drawing_lock:
            self._step = step
            self._unmark()
            self._steps.value = self._steps.options[step]
            self._draw()

    def show_place(self, note: Note) -> None:
        """Fly there, and mark it."""
        self.flying.give(note)

    def export(self, client: Any) -> None:
        """Write the zip, and send it to the browser that asked, if any."""
        self.bench.show_message("Writing the zip ...")
        self.exporting.give(client)

    def _begun(self) -> None:
        self._cancel.visible = True

    def _listed(self, event: Any) -> None:
        if event.client is not None:
            self.choose(self._steps.options.index(self._steps.value))

    def _slid(self) -> None:
        with self.bench.drawing_lock:
            if self._scene is not None and self._entered:
                self._scene.move(self._apart.value)

    def _load(self, _: None) -> None:
        bench = self.bench
        device = bench.project.device
        try:
            found = load_built(device, build_folder(device))
        except (DefsenseError, OSError) as error:
            found = None
            bench.show_error(error)
        with bench.drawing_lock:
            if self._scene is not None:
                self._scene.remove()
            self.device, self._scene, self._step = found, None, 0
            if found is not None:
                wire = device.fabrication.wire_diameter / 2
                self._scene = PartsScene(bench.server, found, device.cord.diameter / 2, wire)
            self._list()
            self._draw()
        self.checking.give(None)

    def _check(self, _: None) -> None:
        device = self.bench.project.device
        folder, stage = build_folder(device), first_outdated(device)
        self._state.content = state_words(
            self.device is not None,
            None if stage is None else stage.title,
            self.bench.build_error,
            describe_changes(device, folder)
            if stage is not None
            else describe_options(recorded_options(device, folder)),
        )

    def _list(self) -> None:
        """Steps, notes and tables of the device that is built."""
        gui, found = self.bench.server.gui, self.device
        steps = () if found is None else found.steps
        self._steps.options = (_ALL, *(f"{k}. {s.title}" for k, s in enumerate(steps, start=1)))
        self._steps.value = _ALL
        for handle in self._notes:
            handle.remove()
        self._notes = []
        notes = () if found is None else found.notes
        self._none.visible = not notes
        with self._warnings:
            for note in notes:
                self._notes.append(gui.add_markdown(f"- {note.text}"))
                if note.place is not None:
                    button = gui.add_button("Show the place", hint="In every browser")
                    button.on_click(self._shower(note))
                    self._notes.append(button)
        if found is not None:
            for table in (*found.tables, found.checks):
                self._tables[table.title].content = table_words(table)
        else:
            for words in self._tables.values():
                words.content = "nothing is built yet"

    def _shower(self, note: Note) -> Any:
        return lambda _: self.show_place(note)

    def _draw(self) -> None:
        found, bench = self.device, self.bench
        step = found.steps[self._step - 1] if found is not None and self._step else None
        self._words.content = "" if step is None else step_words(step, self._step)
        if not self._entered:
            return
        if bench.body is not None:
            bench.body.visible = self._scene is None
        if self._scene is not None:
            self._scene.show(step, self._step - 1, self._apart.value)

    def _fly(self, note: Note) -> None:
        bench = self.bench
        if note.place is None or bench.surface is None:
            return
        with bench.drawing_lock:
            self._unmark()
            self._step = 0
            self._steps.value, self._apart.value = _ALL, 0.0
            self._draw()
            if self._scene is not None and self._entered:
                self._scene.fade()
            self._mark = bench.server.scene.add_icosphere(
                "/place", 0.02 * bench.size, color=_MARK,
                position=tuple(note.place.tolist()),
            )  # fmt: skip
        fly(bench.server, note.place, bench.surface.bounds.mean(axis=0), bench.size)

    def _unmark(self) -> None:
        if self._mark is not None:
            self._mark.remove()
            self._mark = None

    def _export(self, client: Any) -> None:
        device = self.bench.project.device
        path = device.source / export_name(device)
        names = export(device, path)
        self.bench.show_message(f"{len(names)} files in {path}")
        if client is not None:
            client.send_file_download(path.name, path.read_bytes(), save_immediately=True)
