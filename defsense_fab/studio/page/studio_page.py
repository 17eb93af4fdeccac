"""The studio's page: its modes, and the steps that can be undone in all of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...core.errors import DefsenseError
from ..cords.cords_mode import CordsMode
from ..make.make_mode import MakeMode
from ..measure.measure_mode import MeasureMode
from ..project.project import Project
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench

MODES: tuple[type[Mode], ...] = (CordsMode, MakeMode, MeasureMode)
_BRAND = (31, 119, 180)


class StudioPage:
    """Of one project, on a viser server; all browsers see the same."""

    def __init__(self, server: Any, project: Project) -> None:
        self.bench = Workbench(server, project)
        self.modes = {kind.label: kind(self.bench) for kind in MODES}
        self._folders: dict[str, Any] = {}
        self._add_panel()
        project.watchers.append(self._changed)
        self.bench.loaded.append(self._loaded)
        self.bench.load()
        self.enter(next(iter(self.modes)))

    def close(self) -> None:
        """End what is under way."""
        self.bench.project.watchers.remove(self._changed)
        self.bench.close()
        for mode in self.modes.values():
            mode.close()

    def look(self) -> None:
        """Take up what another program has written."""
        try:
            self.bench.project.refresh()
        except DefsenseError as error:
            self.bench.fail(error)

    def enter(self, label: str) -> None:
        """Show a mode's part of the panel, and what it has in the scene."""
        with self.bench.drawing:
            if label == self.bench.mode:
                return
            if self.bench.mode:
                self.modes[self.bench.mode].leave()
            for name, folder in self._folders.items():
                folder.visible = name == label
            self.bench.mode = label
            self._mode.value = label
            self.modes[label].enter()

    def _add_panel(self) -> None:
        gui, bench = self.bench.server.gui, self.bench
        self._title = gui.add_markdown("")
        self._mode = gui.add_button_group("Mode", tuple(self.modes))
        self._mode.on_click(lambda _: self.enter(self._mode.value))
        bench.add_message()
        for at, mode in enumerate(self.modes.values(), start=1):
            self._folders[mode.label] = gui.add_folder(mode.label, visible=False)
            with self._folders[mode.label]:
                gui.add_markdown(mode.hint)
                mode.add_panel()
            self._command(mode.label, mode.hint, str(at), None, self._entering(mode.label))
        self._undo = bench.button("Undo", "Take the last step back", bench.project.undo)
        self._redo = bench.button("Redo", "Do again what was undone", bench.project.redo)
        self._command("Undo", "Take the last step back", "Z", "cmd/ctrl", bench.project.undo)
        self._command("Redo", "Do again", "Z", "cmd/ctrl+shift", bench.project.redo)
        bench.add_progress()
        self._dark = gui.add_checkbox("Dark", False, hint="A dark page, for all who see it")
        self._dark.on_update(lambda _: self._theme())

    def _command(
        self, label: str, text: str, key: Any, modifier: Any, action: Callable[[], Any]
    ) -> None:
        command = self.bench.server.gui.add_command(
            label, description=text, hotkey=key, modifier=modifier
        )
        command.on_trigger(lambda _: self.bench.tried(action))

    def _entering(self, label: str) -> Callable[[], None]:
        return lambda: self.enter(label)

    def _theme(self) -> None:
        self.bench.server.gui.configure_theme(
            dark_mode=self._dark.value, show_logo=False, show_share_button=False, brand_color=_BRAND
        )

    def _changed(self, told: str) -> None:
        self.bench.say(told)
        self._draw()

    def _loaded(self) -> None:
        with self.bench.drawing:
            for mode in self.modes.values():
                mode.built()
        self._draw()

    def _draw(self) -> None:
        """The page as the device is now."""
        project = self.bench.project
        with self.bench.drawing:
            self._title.content = f"## {project.device.name}"
            for button, label, step in (
                (self._undo, "Undo", project.undoes), (self._redo, "Redo", project.redoes)
            ):  # fmt: skip
                button.label = f"{label}: {step}" if step else label
                button.disabled = step is None
            for mode in self.modes.values():
                mode.device_changed()
