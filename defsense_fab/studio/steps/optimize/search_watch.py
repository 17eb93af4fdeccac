"""Judge the layouts of a search while it runs, and publish its paths and errors."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

import numpy as np

from ....workflow.design.cord_trial import CordTrial
from ...background.build_job import CandidateLayout
from ...background.latest_worker import LatestWorker
from ...messages.optimize import Search, SearchedPose
from ...session.device_session import DeviceSession
from .ghost_cords import ghost_cords
from .search_record import SearchRecord, SearchRun, judge_candidate

_MAX_SENT_POINTS = 240  # of the curves
_MIN_INTERVAL_S = 0.1  # between published states


class SearchWatch:
    """Follows the search of the current or last build.

    Args:
        session: The device.
        on_state: Called when a search starts, finds better cords, or ends.

    Attributes:
        search: What was published last.
        worker: Judges the layouts.
    """

    def __init__(self, session: DeviceSession, on_state: Callable[[], None]) -> None:
        self._session, self._on_state = session, on_state
        self._lock = threading.Lock()
        self._kept: list[CandidateLayout] = []
        self._latest: CandidateLayout | None = None
        self._run = SearchRun(session.device)
        self._is_new_build = False
        self._published_at = -_MIN_INTERVAL_S
        self.search = Search(state="none")
        self.worker = LatestWorker(self._judge_layouts, session.show_error)
        session.on_build_started.append(self._start)
        session.on_layout_found.append(self._add)

    @property
    def record(self) -> SearchRecord:
        """Results of the current or last search."""
        return self._run.record

    def make_best(self) -> list[CordTrial]:
        """Make the best layouts on trial until one can be made; return all trials."""
        return self._run.make_best()

    def end(self) -> None:
        """Keep only the best cords; the search has ended."""
        if self.search.state == "running":
            self.worker.give(True)

    def close(self) -> None:
        """End the thread."""
        self.worker.close()

    def _start(self) -> None:
        self._is_new_build = True

    def _add(self, candidate: CandidateLayout) -> None:
        """Add a layout of the search and return at once; called on the build's thread."""
        with self._lock:
            if self._is_new_build:
                self._is_new_build = False
                self._kept, self._run = [], SearchRun(self._session.device)
                self.search = Search(state="running")
            if candidate.is_best:
                self._kept.append(candidate)
            self._latest = candidate
        self.worker.give(False)

    def _judge_layouts(self, has_ended: bool) -> None:
        with self._lock:
            kept, latest, run = self._kept, self._latest, self._run
            self._kept, self._latest = [], None
        is_better = False
        if latest is not None:
            judge = run.load(latest)
            for candidate in [*(k for k in kept if k is not latest), latest]:
                judged = judge_candidate(judge, candidate.sensors)
                is_better = run.record.add(candidate, judged) or is_better
        has_ended = has_ended and not self._session.jobs.is_running
        now = time.monotonic()
        if has_ended or is_better or now - self._published_at >= _MIN_INTERVAL_S:
            self._published_at = now
            self._publish(run, latest, has_ended)
            self._on_state()

    def _publish(self, run: SearchRun, latest: CandidateLayout | None, has_ended: bool) -> None:
        record = run.record
        times, currents, bests = record.curve
        kept = np.unique(
            np.linspace(0, len(times) - 1, min(_MAX_SENT_POINTS, len(times))).astype(int)
        )
        now = {} if record.judged is None else record.judged.pose_errors
        before = {} if run.drawn is None else run.drawn.pose_errors
        is_current_shown = not has_ended and latest is not None and latest is not record.best
        self.search = Search(
            state="ended" if has_ended else "running",
            times=np.round(times[kept], 2).tolist(),
            currents=np.round(currents[kept], 4).tolist(),
            bests=[None if math.isnan(mm) else round(mm, 4) for mm in bests[kept].tolist()],
            drawn=None if run.drawn is None else run.drawn.error,
            best=None if record.judged is None else record.judged.error,
            poses=[
                SearchedPose(pose=pose, drawn=before.get(pose), best=now.get(pose))
                for pose in (now or before)
            ],
            current_cords=ghost_cords(latest.sensors) if is_current_shown and latest else [],
            best_cords=[] if record.best is None else ghost_cords(record.best.sensors),
        )
        self._session.server.publish(self.search)
