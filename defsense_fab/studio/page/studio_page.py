"""The studio's page: its modes, and the steps that can be undone in all of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...core.errors import DefsenseError
from ..cords.cords_mode import CordsMode
from ..device.device_mode import DeviceMode
from ..inside.inside_mode import InsideMode
from ..make.make_mode import MakeMode
from ..measure.measure_mode import MeasureMode
from ..optimise.optimise_mode import OptimiseMode
from ..poses.poses_mode import PosesMode
from ..project.agreement import Agreement
from ..project.project import Project
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .introduction import Introduction

MODES: tuple[type[Mode], ...] = (
    DeviceMode,
    PosesMode,
    InsideMode,
    CordsMode,
    OptimiseMode,
    MakeMode,
    MeasureMode,
)
_BRAND = (31, 119, 180)


class StudioPage:
    """Of one project, on a viser server; all browsers see the same."""

    def __init__(self, server: Any, project: Project, agreement: Agreement | None = None) -> None:
        self.bench = Workbench(server, project, agreement)
        self.modes = {kind.label: kind(self.bench) for kind in MODES}
        self._folders: dict[str, Any] = {}
        self._unread = False  # the file as it is now cannot be read, which is told
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
            if self._unread:
                self._unread = False
                self.bench.say("")
        except DefsenseError as error:
            self._unread = True
            self.bench.fail(error)
        for mode in self.modes.values():
            try:
                mode.look()
            except Exception as error:  # told on the page: the studio goes on
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
        steps = {"Undo": bench.project.undo, "Redo": bench.project.redo}
        self._title = gui.add_markdown("")
        self._mode = gui.add_button_group("Mode", tuple(self.modes))
        self._mode.on_click(lambda _: self.enter(self._mode.value))
        self._step = gui.add_button_group("Step", ("Undo", "Redo"), hint="Ctrl+Z and Ctrl+Shift+Z")
        self._step.on_click(lambda _: bench.tried(steps[self._step.value]))
        self._steps = gui.add_markdown("")
        bench.add_message()
        self._introduction = Introduction(gui, self.modes, self.enter)
        for at, mode in enumerate(self.modes.values(), start=1):
            self._folders[mode.label] = gui.add_folder(mode.label, visible=False)
            with self._folders[mode.label]:
                gui.add_markdown(mode.hint)
                mode.add_panel()
            bench.command(mode.label, mode.hint, self._entering(mode.label), str(at))
        bench.command("Undo", "Take the last step back", bench.project.undo, "Z", "cmd/ctrl")
        bench.command("Redo", "Do again", bench.project.redo, "Z", "cmd/ctrl+shift")
        bench.add_progress()
        with gui.add_folder("Help", expand_by_default=False):
            bench.button("Introduction", "A step for each mode", self._introduction.begin)
            bench.button("Keys", "What each key does", self._show_keys)
            self._dark = gui.add_checkbox("Dark", False, hint="A dark page, for all who see it")
            self._dark.on_update(lambda _: self._theme())
        bench.command("Keys", "This sheet of keys", self._show_keys, "K")
        bench.command("Introduction", "A walk through the studio", self._introduction.begin, "I")

    def _entering(self, label: str) -> Callable[[], None]:
        return lambda: self.enter(label)

    def _show_keys(self) -> None:
        rows = [f"| {key} | {text} |" for key, text in self.bench.keys]
        modal = self.bench.server.gui.add_modal("Keys")
        with modal:
            self.bench.server.gui.add_markdown("\n".join(["| key | |", "|---|---|", *rows]))
            self.bench.server.gui.add_markdown("Ctrl+K finds every command by its name.")
            self.bench.server.gui.add_button("Close").on_click(lambda _: modal.close())

    def _theme(self) -> None:
        self.bench.server.gui.configure_theme(
            dark_mode=self._dark.value, show_logo=False, show_share_button=False, brand_color=_BRAND
        )

    def _changed(self, told: str) -> None:
        # What was done is read beside Undo already.
        self.bench.say("" if told == self.bench.project.undoes else told)
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
            named = (("Undo", project.undoes), ("Redo", project.redoes))
            self.bench.follow()
            self._steps.content = "; ".join(f"{word}: {step}" for word, step in named if step)
            for mode in self.modes.values():
                mode.device_changed()
