"""The search for cords as one watches it: the paths move, and the expected error falls."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from ...core.device import Device
from ...core.errors import DefsenseError
from ...pipeline.design.layout_judge import Judged, LayoutJudge
from ..workbench.build_work import SeenLayout
from ..workbench.cord_tubes import CordTubes
from ..workbench.latest import Latest
from ..workbench.workbench import Workbench
from .search_record import SearchRecord, pose_table

#: As drawn, on the way, and the best so far: grey, orange and blue.
DRAWN, PASSING, BEST = (120, 120, 120), (230, 140, 30), (31, 119, 180)
_THIN = 0.5  # of a cord's radius, as drawn
_WAITING = "Nothing has been searched yet."


class WatchedSearch:
    """Judges what a build's search comes to, on a thread of its own, and shows the newest."""

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self._lock = threading.Lock()
        self._kept: list[SeenLayout] = []
        self._passing: SeenLayout | None = None
        self._device: Device = bench.project.device
        self._judge: LayoutJudge | None = None
        self._drawn: Judged | None = None
        self.record = SearchRecord()
        self.worker = Latest(self._look, bench.fail)
        self._present = CordTubes(bench.server, "/optimise/present")
        self._best = CordTubes(bench.server, "/optimise/best")
        self._sketch = CordTubes(bench.server, "/optimise/drawn")
        self._shown = False

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
            visible=False,
        )
        self._poses = gui.add_markdown("")

    def begin(self) -> None:
        """Another build has begun."""
        with self._lock:
            self._kept, self._passing, self._judge, self._drawn = [], None, None, None
            self._device, self.record = self._bench.project.device, SearchRecord()

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
            kept, passing, record = self._kept, self._passing, self.record
            self._kept, self._passing = [], None
        if passing is None:
            return
        self._load(passing)
        for seen in [*(k for k in kept if k is not passing), passing]:
            record.add(seen, self._judged(seen))
        with self._bench.drawing:
            if record is self.record:
                self._draw(passing)

    def _load(self, seen: SeenLayout) -> None:
        """The judge of the poses that this build has: they may be newer than those of the page."""
        if self._judge is None:
            self._judge = LayoutJudge(self._device, seen.folder)
            if self._device.sensors:
                try:
                    self._drawn = self._judge.judge(self._device.sensors, quick=True)
                except DefsenseError:  # cords of which nothing can be said are told where drawn
                    self._drawn = None

    def _judged(self, seen: SeenLayout) -> Judged | None:
        try:
            return None if self._judge is None else self._judge.judge(seen.sensors, quick=True)
        except DefsenseError:
            return None  # on its way a descent may leave the body

    def _draw(self, passing: SeenLayout | None) -> None:
        record, best = self.record, self.record.best
        if record.judged is not None:
            self._told.content = _told(record, self._drawn)
            before = None if self._drawn is None else self._drawn.per_state
            self._poses.content = pose_table(before, record.judged.per_state)
            self._curve.data, self._curve.visible = _data(record), True
        if not self._shown:
            return
        radius = self._device.cord.diameter / 2
        self._sketch.show(self._device.sensors, DRAWN, _THIN * radius)
        self._best.show(best.sensors if best else (), BEST, radius)
        if passing is not None and best is not passing:
            self._present.show(passing.sensors, PASSING, 0.8 * radius)


def _told(record: SearchRecord, drawn: Judged | None) -> str:
    assert record.judged is not None
    was = "" if drawn is None else f", as drawn {drawn.error:.2f} mm"
    return (
        f"### {record.judged.error:.2f} mm\nexpected on unseen states of the best so far (blue)"
        f"{was}; orange is on its way, grey as drawn"
    )


def _data(record: SearchRecord) -> tuple[Any, ...]:
    curve = record.curve
    return curve if len(curve[0]) else (np.zeros(1), np.ones(1), np.ones(1))
