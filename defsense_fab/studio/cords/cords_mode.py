"""The mode in which the user draws cords and sees their expected error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.curve import Hermite, Plane
from ...core.device.device import Sensor
from ...core.errors import DefsenseError
from ...workflow.design.draw_cord import Snapper
from ...workflow.design.layout_judge import CordComparison, JudgedLayout, LayoutCheck
from ..edits.cords import add_cord, bend_at, move_point, set_path, set_plane
from ..edits.edit import free_name
from ..workbench.controls import NONE
from ..workbench.latest_worker import LatestWorker
from ..workbench.mode import Mode
from ..workbench.workbench import Workbench
from .chosen_cord import ChosenCord
from .cord_results import (
    broken_cords,
    comparison_table,
    error_table,
    limits_table,
    signal_bars,
)
from .cord_scene import CordScene, HandleKind, with_point
from .drawing import DrawingPanel

_NOT_SIMULATED = "Simulate the poses first. Then the expected error of the cords is shown here."
_NOT_COMPARED = "Choose two cords to compare them."
_SEARCHING = "Searching for the cord that lowers the error most"
_SNAP_DISTANCE = 0.01  # times the body's size

Cords = tuple[Sensor, ...]


class CordsMode(Mode):
    """Draw cords and drag their handles; the expected error follows.

    Attributes:
        chosen: The chosen cord and its controls.
        drawing: The controls that draw new cords.
        prediction: The latest prediction for the cords, or None.
        check: The latest check of the limits, or None while there is nothing to check.
        comparison: The latest comparison of two cords, or None.
        error_worker: Predicts the error.
        limits_worker: Checks the limits.
        comparison_worker: Compares two cords and finds the best decoder.
        proposal_worker: Searches for another cord.
    """

    label = "Cords"
    hint = "Draw cords, choose one and drag its points. The expected error follows."

    def __init__(self, bench: Workbench) -> None:
        super().__init__(bench)
        self.chosen = ChosenCord(bench, self.redraw)
        self.drawing = DrawingPanel(bench, self._add_stroke)
        self.prediction: JudgedLayout | None = None
        self.check: LayoutCheck | None = None
        self.comparison: CordComparison | None = None
        self.error_worker = LatestWorker(self._show_error_of, bench.status.show_error)
        self.limits_worker = LatestWorker(self._show_limits, bench.status.show_error)
        self.comparison_worker = LatestWorker(self._show_comparison, bench.status.show_error)
        self.proposal_worker = LatestWorker(self._propose, bench.status.show_error)
        self._before_drag: JudgedLayout | None = None
        self._scene: CordScene | None = None
        self._snapper: Snapper | None = None

    def add_panel(self) -> None:
        gui, button = self.bench.server.gui, self.bench.button
        self._error = gui.add_markdown(_NOT_SIMULATED)
        self._best_decoder = gui.add_markdown("")
        with gui.add_folder("New cord"):
            self.drawing.add_panel()
            button("Straight cord", "Add a cord along the body's middle", self.add_straight)
            button("Propose a cord", "Add the cord that lowers the error most", self.propose)
        with gui.add_folder("Chosen cord"):
            self.chosen.add_panel()
        with gui.add_folder("Signals in each pose"):
            self._signals = gui.add_html("")
        with gui.add_folder("Limits"):
            self._limits = gui.add_markdown("")
        with gui.add_folder("Comparison", expand_by_default=False):
            self._other = gui.add_dropdown("Compare with", (NONE,))
            self._other.on_update(lambda _: self._update_comparison())
            self._comparison = gui.add_markdown(_NOT_COMPARED)
        command = self.bench.command
        command("Straight cord", "Add a straight cord along the body", self.add_straight, "N")
        command("Propose a cord", "Add the cord that lowers the error most", self.propose, "P")
        command("Next cord", "Put the handles on the next cord", self.choose_next, "C")

    def close(self) -> None:
        for worker in (
            self.error_worker,
            self.limits_worker,
            self.comparison_worker,
            self.proposal_worker,
        ):
            worker.close()

    def leave(self) -> None:
        self.drawing.close()
        if self._scene is not None:
            self._scene.clear()

    def enter(self) -> None:
        self.redraw()

    def on_build_loaded(self) -> None:
        if self._scene is not None:
            self._scene.clear()  # it belongs to the previous build
        self.drawing.close()
        if self.bench.surface is not None:
            radius = self.bench.project.device.cord.diameter / 2
            self._scene = CordScene(self.bench.server, radius, self.bench.size, self.drag)

    def on_device_changed(self) -> None:
        self.redraw()

    def choose(self, name: str | None) -> None:
        """Put the handles on a cord."""
        self.chosen.choose(name)

    def choose_next(self) -> None:
        """Put the handles on the cord after the chosen one, and after the last on the first."""
        names = [s.name for s in self.bench.project.device.sensors]
        if names:
            index = names.index(self.chosen.name) + 1 if self.chosen.name in names else 0
            self.choose(names[index % len(names)])

    def compare_with(self, name: str | None) -> None:
        """Compare the chosen cord with another one."""
        self._other.value = name or NONE
        self._update_comparison()

    def drag(self, sensor: Sensor, kind: HandleKind, index: int, has_ended: bool) -> Sensor:
        """Follow the drag of a handle; write the cord once it is released.

        Args:
            sensor: The cord as dragged.
            kind: What the handle moves.
            index: Index of the handle.
            has_ended: Whether the handle was released.

        Returns:
            The cord to draw; its point may have snapped.
        """
        if kind == "points":
            sensor = self._snap(sensor, index)
        if self._scene is not None:
            self._scene.move(sensor)
        if self._before_drag is None:
            self._before_drag = self.prediction
        cords = self._with(sensor)
        self.error_worker.give(cords)
        self.limits_worker.give(cords)
        if has_ended:
            self._before_drag = None
            self.chosen.last_point = None if kind == "plane" else index
            if not self._write(sensor, kind, index):
                self.redraw()
        return sensor

    def add_straight(self) -> None:
        """Add a straight cord along the body."""
        judge = self.bench.judge
        if judge is None:
            self.bench.status.show(_NOT_SIMULATED, "not-simulated")
            return
        self._add(judge.new_cord(self._new_name()))

    def propose(self) -> None:
        """Search in the background for the cord that lowers the error most, and add it."""
        if self.bench.judge is None:
            self.bench.status.show(_NOT_SIMULATED, "not-simulated")
            return
        self.bench.status.show(f"{_SEARCHING} ...", "searching")
        self.proposal_worker.give(self.bench.project.device.sensors)

    def redraw(self) -> None:
        """Draw the device's cords, and update all numbers."""
        with self.bench.drawing_lock:
            sensors = self.bench.project.device.sensors
            self.chosen.show(sensors)
            self.drawing.update()
            self._offer_others(sensors)
            self._snapper = None
            if self._scene is not None and self.is_active:
                self._scene.show(sensors, self.chosen.name, self.chosen.handle_kind)
        self.error_worker.give(sensors)
        self.limits_worker.give(sensors)
        self._update_comparison()

    def _offer_others(self, sensors: Sequence[Sensor]) -> None:
        """Offer the other cords for the comparison."""
        chosen = self.chosen.name
        self._other.options = (NONE, *(s.name for s in sensors if chosen and s.name != chosen))

    def _update_comparison(self) -> None:
        self.comparison_worker.give(self.bench.project.device.sensors)

    def _new_name(self) -> str:
        return free_name("cord", [s.name for s in self.bench.project.device.sensors])

    def _add(self, cord: Sensor) -> None:
        self.chosen.name = cord.name
        self.bench.apply(add_cord(cord.name, cord.plane, cord.curve, sorted(cord.free)))

    def _add_stroke(self, plane: Plane, curve: Hermite) -> None:
        """Add a cord along a stroke, or replace the chosen one's path if the user wants that."""
        chosen = self.chosen.find(self.bench.project.device.sensors)
        replaces = self.chosen.is_replaced_by_strokes
        is_planar = chosen is not None and chosen.curve.is_planar
        if replaces and chosen is not None and is_planar and chosen.plane.coincides(plane):
            points = (plane.to_world(curve.points) - chosen.plane.origin) @ chosen.plane.axes
            tangents = curve.tangents @ plane.axes[:, :2].T @ chosen.plane.axes
            self.bench.apply(set_path(chosen.name, Hermite(points[:, :2], tangents[:, :2])))
            return
        self._add(Sensor(self._new_name(), plane, curve, frozenset({"path"})))

    def _snap(self, sensor: Sensor, index: int) -> Sensor:
        surface = self.bench.surface
        if not self.chosen.is_snapping or surface is None or not sensor.curve.is_planar:
            return sensor
        if self._snapper is None:
            others = [s for s in self.bench.project.device.sensors if s.name != sensor.name]
            self._snapper = Snapper(surface, sensor.plane, others, _SNAP_DISTANCE * self.bench.size)
        snap = self._snapper.snap(sensor.curve.points[index])
        return with_point(sensor, index, snap.point) if snap.target else sensor

    def _write(self, sensor: Sensor, kind: HandleKind, index: int) -> bool:
        if kind == "plane" and sensor.curve.is_planar:
            return self.bench.apply(set_plane(sensor.name, sensor.plane))
        if kind == "tangents":
            return self.bench.apply(bend_at(sensor.name, index, sensor.curve))
        return self.bench.apply(move_point(sensor.name, index, sensor.curve.points[index]))

    def _with(self, sensor: Sensor) -> Cords:
        sensors = self.bench.project.device.sensors
        return tuple(sensor if s.name == sensor.name else s for s in sensors)

    # The following methods run on the threads of the workers.

    def _show_error_of(self, sensors: Cords) -> None:
        judge = self.bench.judge
        if judge is None:
            self._error.content, self._signals.content = _NOT_SIMULATED, ""
            return
        judged = judge.judge(sensors, quick=True)
        self.prediction = judged
        self._error.content = error_table(judged, self._before_drag)
        names = [s.name for s in sensors]
        self._signals.content = signal_bars(judged, names, self.chosen.name) if judged else ""

    def _show_limits(self, sensors: Cords) -> None:
        judge = self.bench.judge
        if judge is None or not sensors:
            self.check, self._limits.content = None, ""
            if self._scene is not None:
                self._scene.mark(np.zeros((0, 3)), frozenset())
            return
        check = judge.check(sensors)
        self.check = check
        self._limits.content = limits_table(check, [s.name for s in sensors])
        if self._scene is not None and self.is_active:
            self._scene.mark(check.broken, broken_cords(check))

    def _show_comparison(self, sensors: Cords) -> None:
        judge = self.bench.judge
        best = judge.judge(sensors) if judge is not None and sensors else None
        self._best_decoder.content = (
            f"With the best decoder ({best.decoder}): **{best.error:.2f} mm**" if best else ""
        )
        chosen, other = self.chosen.name, self._other.value
        names = [s.name for s in sensors]
        if judge is None or chosen not in names or other not in names:
            self.comparison, self._comparison.content = None, _NOT_COMPARED
            return
        judged = judge.judge(sensors, quick=True)
        if judged is not None and chosen is not None:
            self.comparison = judge.compare(sensors, judged, (chosen, other))
            self._comparison.content = comparison_table(self.comparison)

    def _propose(self, sensors: Cords) -> None:
        judge = self.bench.judge
        if judge is None:
            return
        before = judge.judge(sensors, quick=True)
        try:
            cord = judge.propose(self._new_name(), sensors, self._show_search)
        except DefsenseError as error:
            self.bench.status.show_error(error)
            return
        after = judge.judge((*sensors, cord), quick=True)
        cord = replace(cord, name=self._new_name())  # the name may have been taken meanwhile
        self._add(cord)
        if after is not None:
            change = f"from {before.error:.2f} " if before is not None else ""
            self.bench.status.show(
                f"`{cord.name}` changes the expected error {change}to {after.error:.2f} mm.",
                "cord-proposed",
            )

    def _show_search(self, share: float, _: str) -> None:
        self.bench.status.show(f"{_SEARCHING}: {share:.0%}", "searching")
