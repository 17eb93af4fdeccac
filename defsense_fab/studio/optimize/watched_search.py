"""The search for cords as one watches it: the paths move, and the expected error falls."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.build_folder import build_folder
from ...core.device.device import Device, Sensor
from ...core.errors import DefsenseError
from ...optimize.prediction.layout_judge import JudgedLayout, LayoutJudge
from ..workbench.build_job import CandidateLayout
from ..workbench.cord_tubes import CordTubes
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_tables import escape_cell, full_pose_errors
from ..workbench.workbench import Workbench

# What a search for cords has come to so far.

_MOST = 1200  # points of the curve; every other one goes when there are more


@dataclass
class SearchRecord:
    """Of one build: the curve, as s of work, the error (mm) of the layout that was passed then and
    of the best until then; the `best` layout that keeps every limit, and what is expected of it."""

    best: CandidateLayout | None = None
    judged: JudgedLayout | None = None
    _rows: list[tuple[float, float, float]] = field(default_factory=list)
    _begun: float = 0.0

    def add(self, seen: CandidateLayout, judged: JudgedLayout | None) -> bool:
        """Whether it is the best so far; `judged` is None where nothing can be said of it."""
        if judged is None:
            return False
        better = seen.kept and (self.judged is None or judged.error < self.judged.error)
        if better:
            self.best, self.judged = seen, judged
        least = math.nan if self.judged is None else self.judged.error
        if not self._rows:
            self._begun = seen.seconds
        self._rows.append((seen.seconds - self._begun, judged.error, least))
        if len(self._rows) > _MOST:
            self._rows = self._rows[::2]
        return better

    @property
    def curve(self) -> tuple[Float, Float, Float]:
        """Seconds, errors on the way and least errors (n,), of which some may be unknown (NaN)."""
        rows = np.array(self._rows, float).reshape(-1, 3)
        return rows[:, 0].copy(), rows[:, 1].copy(), rows[:, 2].copy()


def pose_table(before: Mapping[str, float] | None, now: Mapping[str, float]) -> str:
    """Markdown: the error of each pose at its extreme, as drawn and now, of errors by state."""
    was = {} if before is None else full_pose_errors(before)
    rows = full_pose_errors(now)
    lines = ["| pose | as drawn | now |", "|---|---:|---:|"]
    for pose, mm in rows.items():
        drawn = f"{was[pose]:.2f}" if pose in was else "-"
        lines.append(f"| {escape_cell(pose)} | {drawn} | **{mm:.2f}** mm |")
    return "\n".join(lines)


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
    drawn: JudgedLayout | None = None

    def load(self, seen: CandidateLayout) -> LayoutJudge:
        """The judge of the poses that this build has: they may be newer than those of the page."""
        if self.judge is None:
            folder = seen.folder if seen.folder.exists() else build_folder(self.device)
            self.judge = LayoutJudge(self.device, folder)
            self.drawn = _judged(self.judge, self.device.sensors)
        return self.judge


def _judged(judge: LayoutJudge, sensors: Sequence[Sensor]) -> JudgedLayout | None:
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
        self._kept: list[CandidateLayout] = []
        self._passing: CandidateLayout | None = None
        self._run = _Run(bench.project.device)
        self.worker = LatestWorker(self._look, bench.show_error)
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

    def see(self, seen: CandidateLayout) -> None:
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
        with self._bench.drawing_lock:
            if run is self._run:
                self._draw(passing)

    def _draw(self, passing: CandidateLayout | None) -> None:
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


def _told(judged: JudgedLayout, drawn: JudgedLayout | None) -> str:
    was = "" if drawn is None else f", as drawn {drawn.error:.2f} mm"
    return (
        f"### {judged.error:.2f} mm\nexpected on unseen states of the best so far (blue)"
        f"{was}; orange is on its way, grey as drawn"
    )


def _data(record: SearchRecord) -> tuple[Any, ...]:
    curve = record.curve
    return curve if len(curve[0]) else (np.zeros(1), np.ones(1), np.ones(1))
