"""What the modes work on: the device and its build, and the page's server."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.device.build_folder import build_folder
from ...core.device.device import Device
from ...core.errors import DefsenseError, StorageError
from ...core.mesh import Surface
from ...optimize.prediction.layout_judge import LayoutJudge
from ...runtime.view.camera import look_at_body
from ...store.body import load_surface
from ...store.fields import INDEX
from ..edits.edit import Edit
from ..project.agreement import Agreement
from ..project.project import Project
from .build_work import BuildWork, SeenLayout
from .latest import Latest
from .script_question import ScriptQuestion

_BODY = (150, 180, 205)
_HELD = {None: "", "cmd/ctrl": "Ctrl+", "cmd/ctrl+shift": "Ctrl+Shift+"}


class Workbench:
    """Of one project, on a viser server; all browsers see the same."""

    def __init__(self, server: Any, project: Project, agreement: Agreement | None = None) -> None:
        self.server, self.project = server, project
        self.agreement = agreement or Agreement()
        self.question = ScriptQuestion(server)
        self.drawing = threading.RLock()  # buttons, hands and builds have threads of their own
        self.mode = ""  # the label of the one that is entered
        self.surface: Surface | None = None  # of the body at rest, once it has been made
        self.built = False  # whether that is the body of a build
        self.judge: LayoutJudge | None = None  # once the poses are simulated
        self.body: Any = None  # in the scene; its `visible` belongs to the mode that is entered
        self.keys: list[tuple[str, str]] = []  # and what they do, for the sheet of keys
        self._judged_by = ""
        self._judging = Latest(self._judge_again, self.fail)
        self.builds = BuildWork(self._progress, self._ended, self._found, self._stood)
        self.problem: str | None = None  # of the last build, where it failed
        #: Told when a build begins, and of layouts that its search comes to: the latter on the
        #: build's thread, so that listeners return at once.
        self.begun: list[Callable[[], None]] = []
        self.seen: list[Callable[[SeenLayout], None]] = []
        #: Told after a build, made or not, and what is known of the body is loaded.
        self.loaded: list[Callable[[], None]] = []
        self._message: Any = None
        self._bar: Any = None
        self._said: Any = None

    @property
    def size(self) -> float:
        """The body's largest extent, mm; 100 while there is none."""
        return 100.0 if self.surface is None else float(np.ptp(self.surface.vertices, axis=0).max())

    def add_message(self) -> None:
        """Where `say` and `fail` are read, at this place of the panel."""
        self._message = self.server.gui.add_markdown("")

    def add_progress(self) -> None:
        """Where builds are followed, at this place of the panel."""
        self._bar = self.server.gui.add_progress_bar(0.0, visible=False)
        self._said = self.server.gui.add_markdown("")

    def say(self, told: str) -> None:
        """Markdown, until the next."""
        self._message.content = told

    def fail(self, error: Exception) -> None:
        """What went wrong; the studio goes on."""
        self._message.content = f"**{error}**"

    def do(self, edit: Edit) -> bool:
        """Change the device's file; False where that is refused, which is told."""
        try:
            self.project.do(edit)
        except DefsenseError as error:
            self.fail(error)
            return False
        return True

    def button(self, label: str, hint: str, action: Callable[[], Any], **look: Any) -> Any:
        """A button whose errors are told on the page."""
        button = self.server.gui.add_button(label, hint=hint, **look)
        button.on_click(lambda _: self.tried(action))
        return button

    def command(
        self,
        label: str,
        text: str,
        action: Callable[[], Any],
        key: str | None = None,
        modifier: str | None = None,
    ) -> None:
        """What the palette (Ctrl+K) offers, and a key does: a letter or digit, alone or with
        "cmd/ctrl" or "cmd/ctrl+shift"."""
        made = self.server.gui.add_command(label, description=text, hotkey=key, modifier=modifier)
        made.on_trigger(lambda _: self.tried(action))
        if key is not None:
            self.keys.append((_HELD[modifier] + key, text))

    def tried(self, action: Callable[[], Any]) -> None:
        """Do it; what it raises of the project's errors is told on the page."""
        try:
            action()
        except DefsenseError as error:
            self.fail(error)

    def may_run(self, then: Callable[[], Any]) -> bool:
        """Whether the body's script may run. Where a person must agree first, the page asks, and
        `then` is done once that has happened. All that makes the body comes by here. Raises
        BodyError where the script cannot be read."""
        script = self.agreement.asked(self.project.device.body)
        if script is None:
            return True

        def agreed() -> None:
            self.tried(lambda: self.agreement.give(script))
            self.tried(then)

        def refused() -> None:
            self.say(
                f"`{script.path.name}` was not run: nothing is made of it until you agree. Make the"
                " body again to be asked."
            )

        with self.drawing:
            self.question.ask(script, agreed, refused)
        return False

    def build(self, stage: str) -> bool:
        """Build up to a stage beside the page; whether it began, which it does not before a person
        has agreed to the script."""
        if not self.may_run(lambda: self.build(stage)):
            return False
        if not self.builds.start(self.project.folder, stage):
            self.say("A build is running; cancel it, or wait for it.")
            return False
        self._bar.visible, self._bar.value = True, 0.0
        for told in self.begun:
            told()
        return True

    def follow(self) -> None:
        """The device has changed: what judges cords is made anew where that is of other cords,
        printers or decoders."""
        if self.judge is not None and judged_by(self.project.device) != self._judged_by:
            self._judging.give(self.project.device)

    def load(self) -> None:
        """What the last build says: the body, and the poses' fields."""
        folder = build_folder(self.project.device)
        try:
            self.surface = load_surface(folder)
            self.built = True
        except OSError:
            self.built = False  # a body may have been made by itself
        except Exception as error:  # files of others, or cut off: readers raise anything
            self.built = False
            self._damaged(error)
        self._load_judge(self.project.device)
        if self.surface is not None:
            self._show_body(self.surface)
        for told in self.loaded:
            told()

    def _load_judge(self, device: Device) -> None:
        folder = build_folder(device)
        self.judge, self._judged_by = None, judged_by(device)
        try:
            self.judge = LayoutJudge(device, folder)
        except StorageError as error:
            if (folder / INDEX).exists():
                self._damaged(error)
        except (DefsenseError, OSError):
            return  # there is nothing to judge by
        except Exception as error:
            self._damaged(error)

    def _judge_again(self, device: Device) -> None:
        if judged_by(device) != self._judged_by:
            self._load_judge(device)
            for told in self.loaded:
                told()

    def take_surface(self, surface: Surface) -> None:
        """A body of which nothing is built yet."""
        self.surface = surface
        self._show_body(surface)
        for told in self.loaded:
            told()

    def close(self) -> None:
        """End a build that is running."""
        self.question.close()
        self._judging.close()
        self.builds.close()

    def _show_body(self, surface: Surface) -> None:
        first = self.body is None
        shown = first or self.body.visible
        self.body = self.server.scene.add_mesh_simple(
            "/body", surface.vertices.astype(np.float32), surface.faces.astype(np.uint32),
            color=_BODY, opacity=0.35, side="double", visible=shown,
        )  # fmt: skip
        if first:
            self.server.scene.set_up_direction("+z")
            look_at_body(self.server, surface.vertices)

    def _damaged(self, error: Exception) -> None:
        """The build is there, and is none."""
        if not isinstance(error, DefsenseError):
            told = " ".join(str(error).split())
            error = StorageError(
                f"the build is damaged ({type(error).__name__}: {told}): build again"
            )
        self.fail(error)

    def _progress(self, share: float, told: str) -> None:
        self._bar.value = 100 * share
        self._said.content = told

    def _ended(self, problem: str | None) -> None:
        self._bar.visible = False
        self.problem = problem
        self._said.content = "done" if problem is None else f"**{problem}**"
        self.load()

    def _found(self, seen: SeenLayout) -> None:
        for told in self.seen:
            told(seen)

    def _stood(self, stands: bool) -> None:
        self._said.content = "**paused**" if stands else "goes on"


def judged_by(device: Device) -> str:
    """What of a device decides how cords are judged, besides its body and poses."""
    return repr((device.cord, device.fabrication, device.decoder, device.channel_diameter))
