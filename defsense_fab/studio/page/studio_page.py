"""The page of a device: its modes, the steps that can be undone, and the introduction."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from ...core.errors import DefsenseError
from ..cords.cords_mode import CordsMode
from ..device.device_mode import DeviceMode
from ..inside.inside_mode import InsideMode
from ..make.make_mode import MakeMode
from ..measure.measure_mode import MeasureMode
from ..optimize.optimize_mode import OptimizeMode
from ..poses.poses_mode import PosesMode
from ..project.agreement import Agreement
from ..project.project import Project
from ..workbench.mode import Mode
from ..workbench.page_texts import markdown_table
from ..workbench.workbench import Workbench

MODES: tuple[type[Mode], ...] = (
    DeviceMode,
    PosesMode,
    InsideMode,
    CordsMode,
    OptimizeMode,
    MakeMode,
    MeasureMode,
)
#: Steps of the introduction: the label of the mode, and what the user does in it.
STEPS = (
    (
        DeviceMode.label,
        "**The body.** Set its dimensions with the sliders, and choose the material, the cord and"
        " the printer. Every change is written to `device.toml`; *Undo* reverts it.",
    ),
    (
        PosesMode.label,
        "**The poses to sense.** Each pose holds some regions and moves others. Choose a pose and"
        " turn its gizmo: the body follows. Then press *Simulate the poses* in"
        f" *{OptimizeMode.label}*.",
    ),
    (
        InsideMode.label,
        "**The strain inside the body.** A section is colored by the stretch in a pose. The heat"
        " map shows where another cord would reduce the error most.",
    ),
    (
        CordsMode.label,
        "**The sensors.** Press *Draw by hand* and draw a line along the body, or *Propose a"
        " cord*. Choose a cord and drag its points: the expected error follows. Parts that"
        " violate a limit turn red.",
    ),
    (
        OptimizeMode.label,
        "**Better paths.** The optimizer moves the cords that are not locked to reduce the error."
        " Take its cords, or keep yours.",
    ),
    (
        MakeMode.label,
        "**The parts.** *Build everything* cuts the body along the planes of the cords, adds"
        " grooves, and writes the parts, the cut list and the guide. Step through the assembly,"
        " and export the files.",
    ),
    (
        MeasureMode.label,
        "**The device in use.** Without a printed device, use its simulated twin: record a"
        " session, train a model, and watch it live.",
    ),
)
_BRAND_COLOR = (31, 119, 180)


class StudioPage:
    """The page of one project, on a viser server; all browsers see the same.

    Args:
        server: The viser server.
        project: The folder of the device.
        agreement: The scripts that the user has agreed to run.

    Attributes:
        bench: The device, its build and the page, which the modes share.
        modes: The modes by their labels.
        introduction: A walk through the modes.
    """

    def __init__(self, server: Any, project: Project, agreement: Agreement | None = None) -> None:
        self.bench = Workbench(server, project, agreement)
        self.modes = {kind.label: kind(self.bench) for kind in MODES}
        self._folders: dict[str, Any] = {}
        self._has_file_error = False
        self._add_panel()
        project.watchers.append(self._on_device_changed)
        self.bench.on_build_loaded.append(self._on_build_loaded)
        self.bench.load()
        self.enter(next(iter(self.modes)))

    @property
    def visible_modes(self) -> list[str]:
        """Labels of the modes whose panel is visible."""
        return [label for label, folder in self._folders.items() if folder.visible]

    def close(self) -> None:
        """End all running work."""
        self.bench.project.watchers.remove(self._on_device_changed)
        self.bench.close()
        for mode in self.modes.values():
            mode.close()

    def poll(self) -> None:
        """Follow changes by other programs."""
        try:
            self.bench.project.refresh()
            if self._has_file_error:
                self._has_file_error = False
                self.bench.status.show("")
        except DefsenseError as error:
            self._has_file_error = True
            self.bench.status.show_error(error)
        for mode in self.modes.values():
            try:
                mode.poll()
            except Exception as error:  # shown on the page: the studio continues
                self.bench.status.show_error(error)

    def enter(self, label: str) -> None:
        """Activate a mode: show its panel and its objects in the scene."""
        with self.bench.drawing_lock:
            if label == self.bench.mode:
                return
            if self.bench.mode:
                self.modes[self.bench.mode].leave()
            for name, folder in self._folders.items():
                folder.visible = name == label
            self.bench.mode = label
            self._mode_buttons.value = label
            self.modes[label].enter()

    def _add_panel(self) -> None:
        gui, bench = self.bench.server.gui, self.bench
        steps = {"Undo": bench.project.undo, "Redo": bench.project.redo}
        self._title = gui.add_markdown("")
        self._mode_buttons = gui.add_button_group("Mode", tuple(self.modes))
        self._mode_buttons.on_click(lambda _: self.enter(self._mode_buttons.value))
        step_buttons = gui.add_button_group("Step", tuple(steps), hint="Ctrl+Z and Ctrl+Shift+Z")
        step_buttons.on_click(lambda _: bench.run_action(steps[step_buttons.value]))
        self._steps_text = gui.add_markdown("")
        bench.status.add_panel(gui)
        self.introduction = Introduction(gui, self.modes, self.enter)
        for at, mode in enumerate(self.modes.values(), start=1):
            self._folders[mode.label] = gui.add_folder(mode.label, visible=False)
            with self._folders[mode.label]:
                gui.add_markdown(mode.hint)
                mode.add_panel()
            bench.command(mode.label, mode.hint, self._enter_action(mode.label), str(at))
        bench.command("Undo", "Undo the last step", bench.project.undo, "Z", "cmd/ctrl")
        bench.command("Redo", "Redo the last step", bench.project.redo, "Z", "cmd/ctrl+shift")
        bench.add_progress()
        self._add_help()

    def _add_help(self) -> None:
        gui, bench = self.bench.server.gui, self.bench
        start = self.introduction.start
        with gui.add_folder("Help", expand_by_default=False):
            bench.button("Introduction", "Walk through the modes", start)
            bench.button("Keys", "Show the keyboard shortcuts", self._show_keys)
            dark = gui.add_checkbox("Dark theme", False, hint="Use a dark page in all browsers")
            dark.on_update(lambda _: self._set_theme(dark.value))
        bench.command("Keys", "Show the keyboard shortcuts", self._show_keys, "K")
        bench.command("Introduction", "Walk through the modes", start, "I")

    def _enter_action(self, label: str) -> Callable[[], None]:
        return lambda: self.enter(label)

    def _show_keys(self) -> None:
        gui = self.bench.server.gui
        modal = gui.add_modal("Keys")
        with modal:
            gui.add_markdown(markdown_table(["Key", "Action"], self.bench.keys, "l"))
            gui.add_markdown("Press Ctrl+K to find a command by its name.")
            gui.add_button("Close").on_click(lambda _: modal.close())

    def _set_theme(self, is_dark: bool) -> None:
        self.bench.server.gui.configure_theme(
            dark_mode=is_dark, show_logo=False, show_share_button=False, brand_color=_BRAND_COLOR
        )

    def _on_device_changed(self, name: str) -> None:
        # The name of an applied edit is shown next to Undo already.
        self.bench.status.show("" if name == self.bench.project.undo_name else name)
        self._update()

    def _on_build_loaded(self) -> None:
        with self.bench.drawing_lock:
            for mode in self.modes.values():
                mode.on_build_loaded()
        self._update()

    def _update(self) -> None:
        """Show the device as it is now."""
        project = self.bench.project
        with self.bench.drawing_lock:
            self._title.content = f"## {project.device.name}"
            self.bench.update_judge()
            steps = (("Undo", project.undo_name), ("Redo", project.redo_name))
            self._steps_text.content = "; ".join(f"{word}: {name}" for word, name in steps if name)
            for mode in self.modes.values():
                mode.on_device_changed()


class Introduction:
    """A walk through the modes in a folder of the panel.

    Args:
        gui: The viser GUI.
        modes: Labels of the modes; steps of other modes are left out.
        enter: Activates a mode.
    """

    def __init__(self, gui: Any, modes: Collection[str], enter: Callable[[str], None]) -> None:
        self._steps = [step for step in STEPS if step[0] in modes]
        self._enter, self._at = enter, 0
        self._folder = gui.add_folder("Introduction", visible=False)
        with self._folder:
            self._text = gui.add_markdown("")
            self._next = gui.add_button("Next")
            self._next.on_click(lambda _: self.go(self._at + 1))
            gui.add_button("Back").on_click(lambda _: self.go(self._at - 1))
            gui.add_button("Close the introduction").on_click(lambda _: self.close())

    @property
    def step(self) -> int | None:
        """Index of the step that is shown, or None while the introduction is closed."""
        return self._at if self._folder.visible else None

    def start(self) -> None:
        """Show the first step."""
        self.go(0)

    def go(self, at: int) -> None:
        """Show a step; after the last one the introduction closes."""
        if at >= len(self._steps):
            self.close()
            return
        self._at = max(at, 0)
        mode, text = self._steps[self._at]
        self._text.content = f"{self._at + 1} of {len(self._steps)}: {text}"
        self._next.label = "Next" if self._at + 1 < len(self._steps) else "Done"
        self._folder.visible = True
        self._enter(mode)

    def close(self) -> None:
        """Hide the introduction; it can be started again."""
        self._folder.visible = False
