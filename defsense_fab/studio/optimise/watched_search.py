"""The search for cords as one watches it: the paths move, and the expected error falls."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core.device.build_folder import build_folder
from ...core.device.device import Device, Sensor
from ...core.errors import DefsenseError
from ...optimize.prediction.layout_judge import Judged, LayoutJudge
from ..workbench.build_work import SeenLayout
from ..workbench.cord_tubes import CordTubes
from ..workbench.latest import Latest
from ..workbench.workbench import Workbench
from .search_record import SearchRecord, pose_table

#: As drawn, on the way, and the best so far: grey, orange and blue.
DRAWN, PASSING, BEST = (120, 120, 120), (230, 140, 30), (31, 119, 180)
_THIN = 0.5  # of a cord's radius, as drawn
_WAITING = "Nothing has been searched yet."


@dataclass
class _Run:
    """One build's search: of which device, what it has come to, and what the drawn cords expect."""

    device: Device
    record: SearchRecord = field(default_factory=SearchRecord)
    judge: LayoutJudge | None = None
    drawn: Judged | None = None

    def load(self, seen: SeenLayout) -> LayoutJudge:
        """The judge of the poses that this build has: they may be newer than those of the page."""
        if self.judge is None:
            folder = seen.folder if seen.folder.exists() else build_folder(self.device)
            self.judge = LayoutJudge(self.device, folder)
            self.drawn = _judged(self.judge, self.device.sensors)
        return self.judge


def _judged(judge: LayoutJudge, sensors: Sequence[Sensor]) -> Judged | None:
    """None where nothing can be said of them: on its way a descent may leave the body."""
    try:
        return judge.judge(sensors, quick=True)
    except DefsenseError:
        return None


class WatchedSearch:
    """Judges what a build's search comes to, on a thread of its own, and shows the newest."""

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self._lock = threading.Lock()
        self._kept: list[SeenLayout] = []
        self._passing: SeenLayout | None = None
        self._run = _Run(bench.project.device)
        self.worker = Latest(self._look, bench.fail)
        self._present = CordTubes(bench.server, "/optimise/present")
        self._best = CordTubes(bench.server, "/optimise/best")
        self._sketch = CordTubes(bench.server, "/optimise/drawn")
        self._shown = False

    @property
    def record(self) -> SearchRecord:
        """Of the last search, or the one that is under way."""
        return self._run.record

    def add_panel(self) -> None:
        """The numbers and the curve."""
        from viser import uplot

        gui = self._bench.server.gui
        self._told = gui.add_markdown(_WAITING)
        self._curve = gui.add_uplot(
            _data(SearchRecord()),
            (
                uplot.Series(label="s of work"),
                uplot.Series(label="on the way, mm", stroke="#e68c1e", width=1),
                uplot.Series(label="best so far, mm", stroke="#1f77b4", width=2),
            ),
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(distr=3, log=10)},
            aspect=1.8,
            padding=(12, 24, 0, 0),
            visible=False,
        )
        self._poses = gui.add_markdown("")

    def begin(self) -> None:
        """Another build has begun."""
        with self._lock:
            self._kept, self._passing = [], None
            self._run = _Run(self._bench.project.device)

    def see(self, seen: SeenLayout) -> None:
        """From the build's thread; returns at once."""
        with self._lock:
            if seen.kept:
                self._kept.append(seen)
            self._passing = seen
        self.worker.give(None)

    def show(self, shown: bool) -> None:
        """Whether it is to be seen in the scene; the caller has the `drawing` lock."""
        self._shown = shown
        if not shown:
            for tubes in (self._present, self._best, self._sketch):
                tubes.clear()
        else:
            self._draw(None)

    def done(self) -> None:
        """The search is over: only the best of it stays."""
        self._present.clear()

    def close(self) -> None:
        """End the thread."""
        self.worker.close()

    def _look(self, _: None) -> None:
        with self._lock:
            kept, passing, run = self._kept, self._passing, self._run
            self._kept, self._passing = [], None
        if passing is None:
            return
        judge = run.load(passing)
        for seen in [*(k for k in kept if k is not passing), passing]:
            run.record.add(seen, _judged(judge, seen.sensors))
        with self._bench.drawing:
            if run is self._run:
                self._draw(passing)

    def _draw(self, passing: SeenLayout | None) -> None:
        run = self._run
        judged, best = run.record.judged, run.record.best
        if judged is not None:
            self._told.content = _told(judged, run.drawn)
            before = None if run.drawn is None else run.drawn.per_state
            self._poses.content = pose_table(before, judged.per_state)
            self._curve.data, self._curve.visible = _data(run.record), True
        if not self._shown:
            return
        radius = run.device.cord.diameter / 2
        self._sketch.show(run.device.sensors, DRAWN, _THIN * radius)
        self._best.show(best.sensors if best else (), BEST, radius)
        present = () if passing is None or passing is best else passing.sensors
        self._present.show(present, PASSING, 0.8 * radius)


def _told(judged: Judged, drawn: Judged | None) -> str:
    was = "" if drawn is None else f", as drawn {drawn.error:.2f} mm"
    return (
        f"### {judged.error:.2f} mm\nexpected on unseen states of the best so far (blue)"
        f"{was}; orange is on its way, grey as drawn"
    )


def _data(record: SearchRecord) -> tuple[Any, ...]:
    curve = record.curve
    return curve if len(curve[0]) else (np.zeros(1), np.ones(1), np.ones(1))
