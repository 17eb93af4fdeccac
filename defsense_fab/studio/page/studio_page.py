"""The studio's page: its modes, and the steps that can be undone in all of them."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from ...core.errors import DefsenseError
from ..cords.cords_mode import CordsMode
from ..device.device_mode import DeviceMode
from ..inside.inside_mode import InsideMode
from ..make.make_mode import MakeMode
from ..measure.measure_mode import MeasureMode
from ..optimize.optimize_mode import OptimiseMode
from ..poses.poses_mode import PosesMode
from ..project.agreement import Agreement
from ..project.project import Project
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench

# A walk through the studio, a step for each mode.

#: The mode, and what one does there.
STEPS = (
    ("Device", "**The body.** Its sizes are sliders here; its material, cord and printer are"
     " chosen from the catalogue. All that you change is written to `device.toml`, and *Undo*"
     " takes it back."),
    ("Poses", "**What it must sense.** Each pose holds some regions and moves others. Choose one,"
     " and turn its gizmo: the body follows. Then press *Simulate the poses*, here or in"
     " *Optimise*."),
    ("Inside", "**Where it stretches.** A section through the body, coloured by its stretch in a"
     " pose. The heat map tells where the next cord would help most."),
    ("Cords", "**The sensors.** Press *Draw by hand* and draw a line along the body, or *Propose a"
     " cord*. Choose a cord, and drag its points: the expected error follows. What breaks a limit"
     " turns red."),
    ("Optimise", "**Better paths.** The optimiser moves the cords that are not locked, and the"
     " error falls. Take its cords, or keep yours."),
    ("Make", "**The parts.** *Build everything* cuts the body along the cords' planes, grooves the"
     " faces, and writes parts, cut list and guide. Step through the assembly, and export it all."),
    ("Measure", "**It senses.** Without a printed device its digital twin stands in: record a"
     " session, train, and watch the live model."),
)  # fmt: skip


class Introduction:
    """In a folder of the panel; `enter` goes to a mode. Steps of modes that are not there are left
    out."""

    def __init__(self, gui: Any, modes: Collection[str], enter: Callable[[str], None]) -> None:
        self._steps = [step for step in STEPS if step[0] in modes]
        self._enter, self._at = enter, 0
        self._folder = gui.add_folder("Introduction", visible=False)
        with self._folder:
            self._text = gui.add_markdown("")
            self._next = gui.add_button("Next")
            self._next.on_click(lambda _: self.go(self._at + 1))
            gui.add_button("Back").on_click(lambda _: self.go(self._at - 1))
            gui.add_button("Leave the introduction").on_click(lambda _: self.leave())

    def begin(self) -> None:
        """From the first step."""
        self.go(0)

    def go(self, at: int) -> None:
        """To a step; behind the last one it is over."""
        if at >= len(self._steps):
            self.leave()
            return
        self._at = max(at, 0)
        mode, text = self._steps[self._at]
        self._text.content = f"{self._at + 1} of {len(self._steps)}: {text}"
        self._next.label = "Next" if self._at + 1 < len(self._steps) else "Done"
        self._folder.visible = True
        self._enter(mode)

    def leave(self) -> None:
        """Away with it; it can be begun again."""
        self._folder.visible = False


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
        self.bench.on_build_loaded.append(self._loaded)
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
                self.bench.show_message("")
        except DefsenseError as error:
            self._unread = True
            self.bench.show_error(error)
        for mode in self.modes.values():
            try:
                mode.look()
            except Exception as error:  # told on the page: the studio goes on
                self.bench.show_error(error)

    def enter(self, label: str) -> None:
        """Show a mode's part of the panel, and what it has in the scene."""
        with self.bench.drawing_lock:
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
        self._step.on_click(lambda _: bench.run_action(steps[self._step.value]))
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
        self.bench.show_message("" if told == self.bench.project.undo_name else told)
        self._draw()

    def _loaded(self) -> None:
        with self.bench.drawing_lock:
            for mode in self.modes.values():
                mode.built()
        self._draw()

    def _draw(self) -> None:
        """The page as the device is now."""
        project = self.bench.project
        with self.bench.drawing_lock:
            self._title.content = f"## {project.device.name}"
            named = (("Undo", project.undo_name), ("Redo", project.redo_name))
            self.bench.follow()
            self._steps.content = "; ".join(f"{word}: {step}" for word, step in named if step)
            for mode in self.modes.values():
                mode.on_device_changed()
