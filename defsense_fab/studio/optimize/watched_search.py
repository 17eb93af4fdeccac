"""Show the search for cords while it runs: its paths and the decrease of the expected error."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device, Sensor
from ...core.errors import DefsenseError
from ...workflow.build.results import Build, last_build
from ...workflow.design.layout_judge import JudgedLayout, LayoutJudge
from ..workbench.build_job import CandidateLayout
from ..workbench.cord_tubes import CordTubes
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_texts import escape_cell, markdown_table
from ..workbench.workbench import Workbench

_DRAWN_COLOR, _CURRENT_COLOR, _BEST_COLOR = (120, 120, 120), (230, 140, 30), (31, 119, 180)
_DRAWN_RADIUS, _CURRENT_RADIUS = 0.5, 0.8  # times the cord's radius
_MAX_CURVE_POINTS = 1200  # above which every other point is removed
_NO_SEARCH = "No search has run yet."


@dataclass
class SearchRecord:
    """Results of the search of one build.

    Attributes:
        best: The best layout that keeps every limit, or None.
        judged: Prediction for the best layout, or None.
    """

    best: CandidateLayout | None = None
    judged: JudgedLayout | None = None
    _rows: list[tuple[float, float, float]] = field(default_factory=list)
    _started_at: float = 0.0

    def add(self, candidate: CandidateLayout, judged: JudgedLayout | None) -> bool:
        """Add a layout that the search has come to.

        Args:
            candidate: The layout.
            judged: Its prediction, or None if it cannot be predicted.

        Returns:
            Whether it is the best layout so far.
        """
        if judged is None:
            return False
        is_best = candidate.is_best and (self.judged is None or judged.error < self.judged.error)
        if is_best:
            self.best, self.judged = candidate, judged
        best_error = math.nan if self.judged is None else self.judged.error
        if not self._rows:
            self._started_at = candidate.seconds
        self._rows.append((candidate.seconds - self._started_at, judged.error, best_error))
        if len(self._rows) > _MAX_CURVE_POINTS:
            self._rows = self._rows[::2]
        return is_best

    @property
    def curve(self) -> tuple[Float, Float, Float]:
        """Time of work (n,) s, error of the layout then (n,) mm, and of the best one (n,) mm.

        The error of the best layout is NaN until one has been found.
        """
        rows = np.array(self._rows, float).reshape(-1, 3)
        return rows[:, 0].copy(), rows[:, 1].copy(), rows[:, 2].copy()


@dataclass
class _Run:
    """The search of one build.

    Attributes:
        device: The device.
        record: Results of the search.
        judge: Predicts the errors, once it is loaded.
        drawn: Prediction for the drawn cords.
    """

    device: Device
    record: SearchRecord = field(default_factory=SearchRecord)
    judge: LayoutJudge | None = None
    drawn: JudgedLayout | None = None

    def load(self, candidate: CandidateLayout) -> LayoutJudge:
        """Return the judge of this build's poses, which may be newer than those of the page."""
        if self.judge is None:
            folder = candidate.folder
            build = Build(folder) if folder.exists() else last_build(self.device)
            self.judge = LayoutJudge(self.device, build)
            self.drawn = _judge(self.judge, self.device.sensors)
        return self.judge


class WatchedSearch:
    """Predict the errors of the layouts of a search on a thread, and show the latest layout.

    Args:
        bench: The workbench.

    Attributes:
        worker: Judges and draws the layouts.
    """

    def __init__(self, bench: Workbench) -> None:
        self._bench = bench
        self._lock = threading.Lock()
        self._kept: list[CandidateLayout] = []
        self._latest: CandidateLayout | None = None
        self._run = _Run(bench.project.device)
        self.worker = LatestWorker(self._judge_layouts, bench.status.show_error)
        self._current_tubes = CordTubes(bench.server, "/optimize/current")
        self._best_tubes = CordTubes(bench.server, "/optimize/best")
        self._drawn_tubes = CordTubes(bench.server, "/optimize/drawn")
        self._is_shown = False

    @property
    def record(self) -> SearchRecord:
        """Results of the current or last search."""
        return self._run.record

    @property
    def current_cords(self) -> set[str]:
        """Names of the cords of the search that are drawn."""
        return self._current_tubes.names

    @property
    def best_cords(self) -> set[str]:
        """Names of the best cords that are drawn."""
        return self._best_tubes.names

    def add_panel(self) -> None:
        """Add the numbers and the curve to the open folder of the panel."""
        from viser import uplot

        gui = self._bench.server.gui
        self._text = gui.add_markdown(_NO_SEARCH)
        self._curve = gui.add_uplot(
            _curve_data(SearchRecord()),
            (
                uplot.Series(label="Work (s)"),
                uplot.Series(label="Current layout (mm)", stroke="#e68c1e", width=1),
                uplot.Series(label="Best so far (mm)", stroke="#1f77b4", width=2),
            ),
            scales={"x": uplot.Scale(time=False), "y": uplot.Scale(distr=3, log=10)},
            aspect=1.8,
            padding=(12, 24, 0, 0),
            visible=False,
        )
        self._poses = gui.add_markdown("")

    def start(self) -> None:
        """Forget the previous search; another build has started."""
        with self._lock:
            self._kept, self._latest = [], None
            self._run = _Run(self._bench.project.device)

    def add(self, candidate: CandidateLayout) -> None:
        """Add a layout of the search and return at once; called on the build's thread."""
        with self._lock:
            if candidate.is_best:
                self._kept.append(candidate)
            self._latest = candidate
        self.worker.give(None)

    def show(self, is_shown: bool) -> None:
        """Show or hide the cords of the search, while the drawing lock is held."""
        self._is_shown = is_shown
        if not is_shown:
            for tubes in (self._current_tubes, self._best_tubes, self._drawn_tubes):
                tubes.clear()
        else:
            self._draw(None)

    def end(self) -> None:
        """Keep only the best cords in the scene; the search has ended."""
        self._current_tubes.clear()

    def close(self) -> None:
        """End the thread."""
        self.worker.close()

    def _judge_layouts(self, _: None) -> None:
        with self._lock:
            kept, latest, run = self._kept, self._latest, self._run
            self._kept, self._latest = [], None
        if latest is None:
            return
        judge = run.load(latest)
        for candidate in [*(k for k in kept if k is not latest), latest]:
            run.record.add(candidate, _judge(judge, candidate.sensors))
        with self._bench.drawing_lock:
            if run is self._run:
                self._draw(latest)

    def _draw(self, latest: CandidateLayout | None) -> None:
        run = self._run
        judged, best = run.record.judged, run.record.best
        if judged is not None:
            self._text.content = _error_text(judged, run.drawn)
            before = None if run.drawn is None else run.drawn.pose_errors
            self._poses.content = pose_table(before, judged.pose_errors)
            self._curve.data, self._curve.visible = _curve_data(run.record), True
        if not self._is_shown:
            return
        radius = run.device.cord.diameter / 2
        self._drawn_tubes.show(run.device.sensors, _DRAWN_COLOR, _DRAWN_RADIUS * radius)
        self._best_tubes.show(best.sensors if best else (), _BEST_COLOR, radius)
        current = () if latest is None or latest is best else latest.sensors
        self._current_tubes.show(current, _CURRENT_COLOR, _CURRENT_RADIUS * radius)


def pose_table(before: Mapping[str, float] | None, now: Mapping[str, float]) -> str:
    """Return the error of each pose at its largest level in markdown.

    Args:
        before: Errors of the drawn cords by pose, mm, or None.
        now: Errors of the best cords by pose, mm.
    """
    drawn = before or {}
    rows = [
        [escape_cell(pose), f"{drawn[pose]:.2f}" if pose in drawn else "-", f"**{error:.2f}** mm"]
        for pose, error in now.items()
    ]
    return markdown_table(["Pose", "Drawn cords", "Best cords"], rows)


def _judge(judge: LayoutJudge, sensors: Sequence[Sensor]) -> JudgedLayout | None:
    """Return the prediction, or None: during a descent cords may leave the body."""
    try:
        return judge.judge(sensors, quick=True)
    except DefsenseError:
        return None


def _error_text(judged: JudgedLayout, drawn: JudgedLayout | None) -> str:
    comparison = "" if drawn is None else f" (drawn cords: {drawn.error:.2f} mm)"
    return (
        f"### {judged.error:.2f} mm\nExpected error of the best cords in unseen states"
        f"{comparison}. Blue: best cords. Orange: current cords of the search. Gray: drawn cords."
    )


def _curve_data(record: SearchRecord) -> tuple[Any, ...]:
    curve = record.curve
    return curve if len(curve[0]) else (np.zeros(1), np.ones(1), np.ones(1))
