"""The studio's page: cords are drawn on it while their expected error is told, and the device is
built from it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from ...core.device import Sensor
from ...core.errors import DefsenseError
from ...pipeline.artifacts.build_folder import build_folder
from ...pipeline.artifacts.layout import LAYOUT, load_layout
from ...pipeline.design.layout_judge import Judged, LayoutJudge
from ...runtime.view.first_look import look_at_body
from ..edits.cords import add_cord, move_point, remove_cord, set_freedoms, take_cords
from ..edits.edit import Edit
from ..edits.tables import free_name
from ..project.project import Project
from .build_work import BuildWork
from .cord_scene import CordScene
from .latest import Latest
from .words import broken_cords, error_table, limit_words

_BODY = (150, 180, 205)
_NOT_BUILT = "Simulate the poses first: their expected error follows the cords then."


class StudioPage:
    """Of one project, on a viser server; all browsers see the same."""

    def __init__(self, server: Any, project: Project) -> None:
        self._server, self._project = server, project
        self._drawing = threading.RLock()  # buttons, hands and builds have threads of their own
        self._judge: LayoutJudge | None = None
        self._chosen: str | None = None
        self._before: Judged | None = None  # the drag that is under way
        self._shown: Judged | None = None
        self._scene: CordScene | None = None
        self._work = BuildWork(self._built_so_far, self._built)
        self._quick = Latest(self._judged, self._failed)
        self._slow = Latest(self._checked, self._failed)
        self._add_panel()
        project.watchers.append(self._changed)
        self._load()

    @property
    def judged(self) -> int:
        """How often cords have been judged."""
        return self._quick.done

    def close(self) -> None:
        """End what is under way."""
        self._project.watchers.remove(self._changed)
        self._work.close()
        self._quick.close()
        self._slow.close()

    def look(self) -> None:
        """Take up what another program has written."""
        try:
            self._project.refresh()
        except DefsenseError as error:
            self._failed(error)

    def choose(self, name: str | None) -> None:
        """Put handles on a cord."""
        self._chosen = name
        self._draw()

    def drawn(self, sensor: Sensor, at: int, ended: bool) -> None:
        """A hand has moved control point `at` of a cord; it is written once the hand lets go."""
        if self._scene is not None:
            self._scene.move(sensor)
        if self._before is None:
            self._before = self._shown
        self._quick.give(self._with(sensor))
        if ended:
            self._before = None
            self._do(move_point(sensor.name, at, sensor.curve.points[at]))

    def _with(self, sensor: Sensor) -> tuple[Sensor, ...]:
        sensors = self._project.device.sensors
        return tuple(sensor if s.name == sensor.name else s for s in sensors)

    # The panel.

    def _add_panel(self) -> None:
        gui = self._server.gui
        self._title = gui.add_markdown("")
        self._message = gui.add_markdown("")
        with gui.add_folder("Expected error"):
            self._error = gui.add_markdown(_NOT_BUILT)
            self._best = gui.add_markdown("")
        with gui.add_folder("Cords"):
            self._list = gui.add_dropdown("Chosen", ("none",), hint="Its points can be dragged")
            self._list.on_update(lambda _: self._listed())
            self._button("Add a cord", "A straight one along the body", self._add)
            self._button("Delete", "The chosen cord", self._delete)
            self._lock = gui.add_checkbox("Locked", False, hint="The optimiser leaves it as it is")
            self._lock.on_update(lambda event: self._locked(event))
            self._limits = gui.add_markdown("")
        with gui.add_folder("Steps"):
            self._undo = self._button("Undo", "Take the last step back", self._project.undo)
            self._redo = self._button("Redo", "Do again what was undone", self._project.redo)
        with gui.add_folder("Make"):
            self._button("Simulate the poses", "Up to the fields", self._build_to("simulate"))
            self._button("Optimise the cords", "Up to the layout", self._build_to("optimize"))
            self._button(
                "Take the optimised cords",
                "In place of those drawn; undo brings them back",
                self._take,
            )
            self._button("Build everything", "Parts, guide and report", self._build_to("report"))
            self._button("Cancel", "The last build stays", self._work.cancel)
            self._bar = gui.add_progress_bar(0.0, visible=False)
            self._said = gui.add_markdown("")

    def _button(self, label: str, hint: str, action: Callable[[], Any]) -> Any:
        button = self._server.gui.add_button(label, hint=hint)

        def clicked(_: Any) -> None:
            try:
                action()
            except DefsenseError as error:
                self._failed(error)

        button.on_click(clicked)
        return button

    def _listed(self) -> None:
        name = self._list.value
        if name != (self._chosen or "none"):
            self.choose(None if name == "none" else name)

    def _add(self) -> None:
        names = [s.name for s in self._project.device.sensors]
        if self._judge is None:
            self._say(_NOT_BUILT)
            return
        cord = self._judge.new_cord(free_name("cord", names))
        self._chosen = cord.name
        self._do(add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free)))

    def _delete(self) -> None:
        if self._chosen is None:
            self._say("Choose a cord first.")
            return
        name, self._chosen = self._chosen, None
        self._do(remove_cord(name))

    def _take(self) -> None:
        folder = build_folder(self._project.device)
        if not (folder / LAYOUT).exists():
            self._say("Optimise the cords first.")
            return
        self._do(take_cords([record.sensor() for record in load_layout(folder).by_channel()]))

    def _locked(self, event: Any) -> None:
        if event.client is None or self._chosen is None:  # set by the page itself
            return
        self._do(set_freedoms(self._chosen, [] if self._lock.value else ["path"]))

    # What changes.

    def _do(self, edit: Edit) -> None:
        try:
            self._project.do(edit)
        except DefsenseError as error:
            self._failed(error)
            self._draw()

    def _changed(self, told: str) -> None:
        self._say(told)
        self._draw()

    def _load(self) -> None:
        """What the last build says: the body, and the poses' fields."""
        device = self._project.device
        folder = build_folder(device)
        try:
            self._judge = LayoutJudge(device, folder)
        except (DefsenseError, OSError):
            self._judge = None
        if self._judge is not None:
            surface = self._judge.surface
            size = float(np.ptp(surface.vertices, axis=0).max())
            self._server.scene.add_mesh_simple(
                "/body", surface.vertices.astype(np.float32), surface.faces.astype(np.uint32),
                color=_BODY, opacity=0.35, side="double",
            )  # fmt: skip
            if self._scene is None:
                self._server.scene.set_up_direction("+z")
                look_at_body(self._server, surface.vertices)
            else:
                self._scene.show((), None, frozenset())  # what is drawn is of the build before
            self._scene = CordScene(self._server, device.cord.diameter / 2, size, self.drawn)
        self._draw()

    def _draw(self) -> None:
        """The page as the device is now."""
        with self._drawing:
            self._draw_now()

    def _draw_now(self) -> None:
        device = self._project.device
        names = [s.name for s in device.sensors]
        if self._chosen not in names:
            self._chosen = None
        self._title.content = f"## {device.name}"
        self._list.options = ("none", *names)
        self._list.value = self._chosen or "none"
        chosen = next((s for s in device.sensors if s.name == self._chosen), None)
        self._lock.value = chosen is not None and not chosen.free
        for button, label, step in (
            (self._undo, "Undo", self._project.undoes), (self._redo, "Redo", self._project.redoes)
        ):  # fmt: skip
            button.label = f"{label}: {step}" if step else label
            button.disabled = step is None
        if self._scene is not None:
            self._scene.show(device.sensors, self._chosen, frozenset())
        self._quick.give(device.sensors)
        self._slow.give(device.sensors)

    def _judged(self, sensors: tuple[Sensor, ...]) -> None:
        if self._judge is None:
            self._error.content = _NOT_BUILT
            return
        self._shown = self._judge.judge(sensors, quick=True)
        self._error.content = error_table(self._shown, self._before)

    def _checked(self, sensors: tuple[Sensor, ...]) -> None:
        if self._judge is None or not sensors:
            self._limits.content = self._best.content = ""
            return
        names = [s.name for s in sensors]
        best = self._judge.judge(sensors)
        if best is not None:
            self._best.content = f"with the best decoder: **{best.error:.2f} mm** ({best.decoder})"
        check = self._judge.check(sensors)
        self._limits.content = limit_words(check, names)
        if self._scene is not None and check.problems:
            self._scene.show(sensors, self._chosen, broken_cords(check, names))

    # Builds.

    def _build_to(self, stage: str) -> Callable[[], None]:
        def begin() -> None:
            if not self._work.start(self._project.folder, stage):
                self._say("A build is running; cancel it, or wait for it.")
                return
            self._bar.visible, self._bar.value = True, 0.0

        return begin

    def _built_so_far(self, share: float, told: str) -> None:
        self._bar.value = 100 * share
        self._said.content = told

    def _built(self, problem: str | None) -> None:
        self._bar.visible = False
        self._said.content = "done" if problem is None else f"**{problem}**"
        self._load()

    def _say(self, told: str) -> None:
        self._message.content = told

    def _failed(self, error: Exception) -> None:
        self._message.content = f"**{error}**"
