"""The mode in which cords are drawn while their expected error is told."""

from __future__ import annotations

from typing import Any

from ...core.device import Sensor
from ...pipeline.design.layout_judge import Judged
from ..edits.cords import add_cord, move_point, remove_cord, set_freedoms
from ..edits.tables import free_name
from ..workbench.latest import Latest
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .cord_scene import CordScene
from .cord_words import broken_cords, error_table, limit_words

_NOT_BUILT = "Simulate the poses first: their expected error follows the cords then."


class CordsMode(Mode):
    """The chosen cord has handles; the error follows while they are dragged."""

    label = "Cords"
    hint = "Choose a cord and drag its points; the expected error follows."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self._chosen: str | None = None
        self._before: Judged | None = None  # the drag that is under way
        self._shown: Judged | None = None
        self._scene: CordScene | None = None
        self._quick = Latest(self._judged, bench.fail)
        self._slow = Latest(self._checked, bench.fail)

    @property
    def judged(self) -> int:
        """How often cords have been judged."""
        return self._quick.done

    def add_panel(self) -> None:
        gui, button = self.bench.server.gui, self.bench.button
        self._error = gui.add_markdown(_NOT_BUILT)
        self._best = gui.add_markdown("")
        self._list = gui.add_dropdown("Chosen", ("none",), hint="Its points can be dragged")
        self._list.on_update(lambda _: self._listed())
        button("Add a cord", "A straight one along the body", self._add)
        button("Delete", "The chosen cord", self._delete)
        self._lock = gui.add_checkbox("Locked", False, hint="The optimiser leaves it as it is")
        self._lock.on_update(lambda event: self._locked(event))
        self._limits = gui.add_markdown("")

    def enter(self) -> None:
        self._draw()

    def leave(self) -> None:
        if self._scene is not None:
            self._scene.show((), None, frozenset())

    def close(self) -> None:
        self._quick.close()
        self._slow.close()

    def built(self) -> None:
        if self._scene is not None:
            self._scene.show((), None, frozenset())  # what is drawn is of the build before
        if self.bench.surface is not None:
            radius = self.bench.project.device.cord.diameter / 2
            self._scene = CordScene(self.bench.server, radius, self.bench.size, self.drawn)

    def device_changed(self) -> None:
        self._draw()

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
            if not self.bench.do(move_point(sensor.name, at, sensor.curve.points[at])):
                self._draw()

    def _with(self, sensor: Sensor) -> tuple[Sensor, ...]:
        sensors = self.bench.project.device.sensors
        return tuple(sensor if s.name == sensor.name else s for s in sensors)

    def _listed(self) -> None:
        name = self._list.value
        if name != (self._chosen or "none"):
            self.choose(None if name == "none" else name)

    def _add(self) -> None:
        names = [s.name for s in self.bench.project.device.sensors]
        if self.bench.judge is None:
            self.bench.say(_NOT_BUILT)
            return
        cord = self.bench.judge.new_cord(free_name("cord", names))
        self._chosen = cord.name
        self.bench.do(add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free)))

    def _delete(self) -> None:
        if self._chosen is None:
            self.bench.say("Choose a cord first.")
            return
        name, self._chosen = self._chosen, None
        self.bench.do(remove_cord(name))

    def _locked(self, event: Any) -> None:
        if event.client is None or self._chosen is None:  # set by the page itself
            return
        self.bench.do(set_freedoms(self._chosen, [] if self._lock.value else ["path"]))

    def _draw(self) -> None:
        """The cords as the device has them now."""
        with self.bench.drawing:
            self._draw_now()

    def _draw_now(self) -> None:
        sensors = self.bench.project.device.sensors
        names = [s.name for s in sensors]
        if self._chosen not in names:
            self._chosen = None
        self._list.options = ("none", *names)
        self._list.value = self._chosen or "none"
        chosen = next((s for s in sensors if s.name == self._chosen), None)
        self._lock.value = chosen is not None and not chosen.free
        self._show(sensors, frozenset())
        self._quick.give(sensors)
        self._slow.give(sensors)

    def _judged(self, sensors: tuple[Sensor, ...]) -> None:
        if self.bench.judge is None:
            self._error.content = _NOT_BUILT
            return
        self._shown = self.bench.judge.judge(sensors, quick=True)
        self._error.content = error_table(self._shown, self._before)

    def _checked(self, sensors: tuple[Sensor, ...]) -> None:
        judge = self.bench.judge
        if judge is None or not sensors:
            self._limits.content = self._best.content = ""
            return
        names = [s.name for s in sensors]
        best = judge.judge(sensors)
        if best is not None:
            self._best.content = f"with the best decoder: **{best.error:.2f} mm** ({best.decoder})"
        check = judge.check(sensors)
        self._limits.content = limit_words(check, names)
        if check.problems:
            with self.bench.drawing:
                self._show(sensors, broken_cords(check, names))

    def _show(self, sensors: tuple[Sensor, ...], broken: frozenset[str]) -> None:
        """In the scene, while this mode is entered."""
        if self._scene is not None and self.bench.mode == self.label:
            self._scene.show(sensors, self._chosen, broken)
