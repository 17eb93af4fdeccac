"""Show the search for cords while it runs: its paths and the decrease of the expected error."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...workflow.design.layout_judge import JudgedLayout
from ..workbench.build_job import CandidateLayout
from ..workbench.cord_tubes import CordTubes
from ..workbench.latest_worker import LatestWorker
from ..workbench.page_texts import escape_cell, markdown_table
from ..workbench.search_record import SearchRecord, SearchRun, judge_candidate
from ..workbench.workbench import Workbench

_DRAWN_COLOR, _CURRENT_COLOR, _BEST_COLOR = (120, 120, 120), (230, 140, 30), (31, 119, 180)
_DRAWN_RADIUS, _CURRENT_RADIUS = 0.5, 0.8  # times the cord's radius
_NO_SEARCH = "No search has run yet."


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
        self._run = SearchRun(bench.project.device)
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
            self._run = SearchRun(self._bench.project.device)

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
            run.record.add(candidate, judge_candidate(judge, candidate.sensors))
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


def _error_text(judged: JudgedLayout, drawn: JudgedLayout | None) -> str:
    comparison = "" if drawn is None else f" (drawn cords: {drawn.error:.2f} mm)"
    return (
        f"### {judged.error:.2f} mm\nExpected error of the best cords in unseen states"
        f"{comparison}. Blue: best cords. Orange: current cords of the search. Gray: drawn cords."
    )


def _curve_data(record: SearchRecord) -> tuple[Any, ...]:
    curve = record.curve
    return curve if len(curve[0]) else (np.zeros(1), np.ones(1), np.ones(1))
