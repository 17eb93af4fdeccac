"""The results of a search for cords while it runs: its best layout and the errors over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ....core.arrays import Float
from ....core.device.device import Device, Sensor
from ....core.errors import DefsenseError, LayoutError
from ....workflow.build.results import Build, last_build, simulation_digest
from ....workflow.design.cord_trial import CordTrial, TrialBench
from ....workflow.design.layout_judge import JudgedLayout, LayoutJudge
from ...background.build_job import CandidateLayout

_MAX_BESTS = 6  # that may be made on trial
_MAX_CURVE_POINTS = 1200  # above which every other point is removed


@dataclass
class SearchRecord:
    """Results of the search of one build.

    Attributes:
        best: The best layout that keeps every limit, or None.
        judged: Prediction for the best layout, or None.
        bests: The best layout and those that were it before, the last one first.
    """

    best: CandidateLayout | None = None
    judged: JudgedLayout | None = None
    bests: list[CandidateLayout] = field(default_factory=list)
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
            self.bests = [candidate, *self.bests][:_MAX_BESTS]
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
class SearchRun:
    """The search of one build.

    Attributes:
        device: The device.
        record: Results of the search.
        judge: Predicts the errors, once it is loaded.
        drawn: Prediction for the drawn cords.
        simulation: Digest of the simulated poses that the judge predicts by.
    """

    device: Device
    record: SearchRecord = field(default_factory=SearchRecord)
    judge: LayoutJudge | None = None
    drawn: JudgedLayout | None = None
    simulation: str = ""

    def load(self, candidate: CandidateLayout) -> LayoutJudge:
        """Return the judge of this build's poses, which may be newer than those of the page."""
        if self.judge is None:
            folder = candidate.folder
            build = Build(folder) if folder.exists() else last_build(self.device)
            self.simulation = simulation_digest(build)
            self.judge = LayoutJudge(self.device, build)
            self.drawn = judge_candidate(self.judge, self.device.sensors)
        return self.judge

    def make_best(self) -> list[CordTrial]:
        """Make the best layouts on trial until one can be made; return all trials.

        Raises:
            LayoutError: The simulation that the search used is gone.
        """
        trials: list[CordTrial] = []
        candidates = list(self.record.bests)
        if not candidates:
            return trials
        bench = self._bench(candidates[0])
        for candidate in candidates:
            trials.append(bench.make(candidate.sensors))
            if trials[-1].problem is None:
                break
        return trials

    def _bench(self, candidate: CandidateLayout) -> TrialBench:
        """Return a bench in the body of the search; other builds use its folder, too."""
        for build in (Build(candidate.folder), last_build(self.device)):
            try:
                if simulation_digest(build) == self.simulation:
                    return TrialBench(self.device, build)
            except (DefsenseError, OSError):
                continue  # a build replaces it
        raise LayoutError(
            "the body and the poses that these cords were found for are no longer there",
            code="build-outdated",
            action="Optimize the cords again",
        )


def judge_candidate(judge: LayoutJudge, sensors: Sequence[Sensor]) -> JudgedLayout | None:
    """Return the prediction, or None: during a descent cords may leave the body."""
    try:
        return judge.judge(sensors)
    except DefsenseError:
        return None
