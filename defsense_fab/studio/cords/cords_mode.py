"""The mode in which cords are drawn while their expected error is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.curve import Hermite, Plane
from ...core.device.device import Sensor
from ...core.errors import DefsenseError
from ...optimize.prediction.layout_judge import JudgedLayout
from ..edits.cords import add_cord, bend_at, move_point, set_path, set_plane
from ..edits.edit import free_name
from ..workbench.latest_worker import LatestWorker
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .chosen_cord import ChosenCord
from .cord_results import comparison
from .cord_scene import CordScene, Part, with_point
from .cord_results import broken_cords, error_table, limit_words
from .drawing import Drawing
from .cord_results import signal_bars
from .snapping import Snapping

NOT_BUILT = "Simulate the poses first: their expected error follows the cords then."
_REACH = 0.01  # of the body's size, that points snap over

Cords = tuple[Sensor, ...]


class CordsMode(Mode):
    """The chosen cord has handles; the error follows while they are dragged."""

    label = "Cords"
    hint = "Draw cords, choose one, drag its points; the expected error follows."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self._before: JudgedLayout | None = None  # the drag that is under way
        self._shown: JudgedLayout | None = None
        self._scene: CordScene | None = None
        self._snapping: Snapping | None = None
        self._drawing = Drawing(bench, self._stroke)
        self._cord = ChosenCord(bench, self.redraw)
        self._quick = LatestWorker(self._judged, bench.show_error)
        self._limits_work = LatestWorker(self._checked, bench.show_error)
        self._slow = LatestWorker(self._weighed, bench.show_error)
        self._proposals = LatestWorker(self._proposed, bench.show_error)

    @property
    def judged(self) -> int:
        """How often cords have been judged."""
        return self._quick.done_count

    def add_panel(self) -> None:
        gui, button = self.bench.server.gui, self.bench.button
        self._error = gui.add_markdown(NOT_BUILT)
        self._best = gui.add_markdown("")
        with gui.add_folder("New cord"):
            self._drawing.add_panel()
            button("Straight cord", "Along the body, through its middle", self.add_straight)
            button("Propose a cord", "The one that lowers the error most", self.propose)
        with gui.add_folder("Chosen cord"):
            self._cord.add_panel()
        with gui.add_folder("Signals in each pose"):
            self._signals = gui.add_html("")
        with gui.add_folder("Limits"):
            self._limits = gui.add_markdown("")
        with gui.add_folder("Compared", expand_by_default=False):
            self._other = gui.add_dropdown("The chosen with", ("none",))
            self._other.on_update(lambda _: self._give_slow())
            self._compared = gui.add_markdown("Choose two cords.")
        command = self.bench.command
        command("Straight cord", "A straight cord along the body", self.add_straight, "N")
        command("Propose a cord", "The cord that lowers the error most", self.propose, "P")
        command("Next cord", "Handles on the next cord", self.choose_next, "C")

    def close(self) -> None:
        for work in (self._quick, self._limits_work, self._slow, self._proposals):
            work.close()

    def leave(self) -> None:
        self._drawing.close()
        if self._scene is not None:
            self._scene.clear()

    def enter(self) -> None:
        self.redraw()

    def on_build_loaded(self) -> None:
        if self._scene is not None:
            self._scene.clear()  # what is drawn is of the build before
        self._drawing.close()
        if self.bench.surface is not None:
            radius = self.bench.project.device.cord.diameter / 2
            self._scene = CordScene(self.bench.server, radius, self.bench.size, self.drawn)

    def on_device_changed(self) -> None:
        self.redraw()

    def choose(self, name: str | None) -> None:
        """Put handles on a cord."""
        self._cord.choose(name)

    def choose_next(self) -> None:
        """Put handles on the cord behind the chosen one, the first behind the last."""
        names = [s.name for s in self.bench.project.device.sensors]
        if names:
            at = names.index(self._cord.name) + 1 if self._cord.name in names else 0
            self.choose(names[at % len(names)])

    def drawn(self, sensor: Sensor, part: Part, at: int, ended: bool) -> Sensor:
        """A hand has moved a control point, a tangent or the plane of a cord; it is written once
        the hand lets go. The cord as it is to be: points snap."""
        if part == "points":
            sensor = self._snapped(sensor, at)
        if self._scene is not None:
            self._scene.move(sensor)
        if self._before is None:
            self._before = self._shown
        cords = self._with(sensor)
        self._quick.give(cords)
        self._limits_work.give(cords)
        if ended:
            self._before = None
            self._cord.touched = None if part == "plane" else at
            if not self._write(sensor, part, at):
                self.redraw()
        return sensor

    def add_straight(self) -> None:
        """A straight cord along the body."""
        judge = self.bench.judge
        if judge is None:
            self.bench.show_message(NOT_BUILT)
            return
        self._add(judge.new_cord(self._new_name()))

    def propose(self) -> None:
        """The cord that lowers the error most, found beside the page."""
        if self.bench.judge is None:
            self.bench.show_message(NOT_BUILT)
            return
        self.bench.show_message("Looking for the cord that lowers the error most ...")
        self._proposals.give(self.bench.project.device.sensors)

    def redraw(self) -> None:
        """The cords as the device has them now."""
        with self.bench.drawing_lock:
            sensors = self.bench.project.device.sensors
            self._cord.show(sensors)
            self._drawing.offer()
            chosen = self._cord.name
            others = tuple(s.name for s in sensors if s.name != chosen)
            options = ("none", *others) if chosen else ("none",)
            if tuple(self._other.options) != options:
                kept = self._other.value
                self._other.options = options
                self._other.value = kept if kept in options else "none"
            self._snapping = None
            if self._scene is not None and self.bench.mode == self.label:
                self._scene.show(sensors, chosen, self._cord.part)
        self._quick.give(sensors)
        self._limits_work.give(sensors)
        self._give_slow()

    def _give_slow(self) -> None:
        self._slow.give(self.bench.project.device.sensors)

    def _new_name(self) -> str:
        return free_name("cord", [s.name for s in self.bench.project.device.sensors])

    def _add(self, cord: Sensor) -> None:
        self._cord.name = cord.name
        self.bench.apply(add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free)))

    def _stroke(self, plane: Plane, curve: Hermite) -> None:
        """A line was drawn: a new cord, or the chosen one anew where that is asked."""
        chosen = self._cord.sensor(self.bench.project.device.sensors)
        if self._cord.redraws and chosen is not None and chosen.plane.coincides(plane):
            local = (plane.to_world(curve.points) - chosen.plane.origin) @ chosen.plane.axes
            ways = curve.tangents @ plane.axes[:, :2].T @ chosen.plane.axes
            self.bench.apply(set_path(chosen.name, Hermite(local[:, :2], ways[:, :2])))
            return
        self._add(Sensor(self._new_name(), plane, curve, frozenset({"path"})))

    def _snapped(self, sensor: Sensor, at: int) -> Sensor:
        surface = self.bench.surface
        if not self._cord.snaps or surface is None:
            return sensor
        if self._snapping is None:
            others = [s for s in self.bench.project.device.sensors if s.name != sensor.name]
            self._snapping = Snapping(surface, sensor.plane, others, _REACH * self.bench.size)
        found = self._snapping(sensor.curve.points[at])
        return with_point(sensor, at, found.place) if found.to else sensor

    def _write(self, sensor: Sensor, part: Part, at: int) -> bool:
        if part == "plane":
            return self.bench.apply(set_plane(sensor.name, sensor.plane))
        if part == "tangents":
            return self.bench.apply(bend_at(sensor.name, at, sensor.curve))
        return self.bench.apply(move_point(sensor.name, at, sensor.curve.points[at]))

    def _with(self, sensor: Sensor) -> Cords:
        sensors = self.bench.project.device.sensors
        return tuple(sensor if s.name == sensor.name else s for s in sensors)

    # On threads of their own.

    def _judged(self, sensors: Cords) -> None:
        judge = self.bench.judge
        if judge is None:
            self._error.content, self._signals.content = NOT_BUILT, ""
            return
        found = judge.judge(sensors, quick=True)
        self._shown = found
        self._error.content = error_table(found, self._before)
        names = [s.name for s in sensors]
        self._signals.content = signal_bars(found, names, self._cord.name) if found else ""

    def _checked(self, sensors: Cords) -> None:
        judge = self.bench.judge
        if judge is None or not sensors:
            self._limits.content = ""
            if self._scene is not None:
                self._scene.mark(np.zeros((0, 3)), frozenset())
            return
        names = [s.name for s in sensors]
        check = judge.check(sensors)
        self._limits.content = limit_words(check, names)
        if self._scene is not None and self.bench.mode == self.label:
            self._scene.mark(check.broken, broken_cords(check, names))

    def _weighed(self, sensors: Cords) -> None:
        judge = self.bench.judge
        best = judge.judge(sensors) if judge is not None and sensors else None
        self._best.content = (
            f"with the best decoder: **{best.error:.2f} mm** ({best.decoder})" if best else ""
        )
        chosen, other = self._cord.name, self._other.value
        names = [s.name for s in sensors]
        if judge is None or chosen not in names or other not in names:
            self._compared.content = "Choose two cords."
            return
        found = judge.judge(sensors, quick=True)
        if found is not None and chosen is not None:
            self._compared.content = comparison(judge, sensors, found, chosen, other)

    def _proposed(self, sensors: Cords) -> None:
        judge = self.bench.judge
        if judge is None:
            return
        before = judge.judge(sensors, quick=True)
        try:
            cord = judge.propose(self._new_name(), sensors, self._searching)
        except DefsenseError as error:
            self.bench.show_error(error)
            return
        after = judge.judge((*sensors, cord), quick=True)
        cord = replace(cord, name=self._new_name())  # another may have been drawn meanwhile
        self._add(cord)
        if after is not None:
            was = f"from {before.error:.2f} " if before is not None else ""
            self.bench.show_message(f"`{cord.name}` takes the expected error {was}to {after.error:.2f} mm.")

    def _searching(self, share: float, _: str) -> None:
        self.bench.show_message(f"Looking for the cord that lowers the error most: {share:.0%}")
