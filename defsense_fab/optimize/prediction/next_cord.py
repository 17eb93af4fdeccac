"""Where in a plane one more cord would help most, beside those that there are.

Through each point of a grid straight cords are laid in several directions; each that has room is
added to the cords that there are, and the best counts. The error is that of `LayoutJudge.judge`,
quick: on states that the decoder was not trained on, by the better of the fast decoders.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ...core.curve import Plane
from ...core.device.device import Sensor
from ...core.errors import LayoutError
from ...decoding.added_channel import unseen_errors
from ..problem.problem import reduce_outputs
from .as_built import assumed_cords
from .body_section import BodySection
from .design_task import DesignTask
from .layout_judge import LayoutJudge
from .predict import predict, read
from .straight_cords import StraightCords

DIRECTIONS = 8
#: Points of the coarse grid and of the fine one, about.
COARSE, FINE = 100, 600
#: What stands in for decoders that are too slow to be fitted thousands of times, as in the search.
_STAND_IN = "quadratic"
_SHORT = 30.0  # mm
_CHUNK = 300  # cords at once, between two looks whether they are still wanted


@dataclass(frozen=True)
class NextCord:
    """Of points (p, 3) mm in the `plane`, `step` mm apart: by how much the best cord through each
    lowers the `error` (mm) of those that there are, `drop` (p,) mm, NaN where none has room, and
    its `ends` (p, 2, 3); how many cords were `tried`, and the `share` of them that is done."""

    plane: Plane
    step: float
    points: Float
    drop: Float
    ends: Float
    error: float
    tried: int
    share: float
    fine: bool

    @property
    def best(self) -> int | None:
        """The point whose cord lowers the error most; None where none does."""
        if np.isnan(self.drop).all() or np.nanmax(self.drop) <= 0:
            return None
        return int(np.nanargmax(self.drop))

    @property
    def best_drop(self) -> float:
        """By how much the best cord lowers the error, mm; 0 where none does."""
        return 0.0 if self.best is None else float(self.drop[self.best])

    @property
    def best_ends(self) -> Float | None:
        """The ends (2, 3) mm of that cord."""
        return None if self.best is None else np.asarray(self.ends[self.best])


def shortest(task: DesignTask) -> float:
    """A short cord, mm: 30, or what the limits ask for at least."""
    return max(_SHORT, float(np.ceil(task.design.limits.shortest)))


def next_cord(
    judge: LayoutJudge,
    body: BodySection,
    plane: Plane,
    sensors: Sequence[Sensor],
    length: float | None,
) -> Iterator[NextCord]:
    """What is known so far, again and again: of a coarse grid, then of a fine one. Cords are
    `length` mm long, or go from skin to skin (None). Whoever stops asking has cancelled the rest.
    Raises LayoutError where the plane misses the body, or sensors leave it."""
    area = body.cut(plane).area
    tests = AddedCord(judge, sensors)
    cords = StraightCords(judge.task, plane, sensors)
    for count in (COARSE, FINE):
        step = max(float(np.sqrt(area / count)), 0.5)
        points, _ = body.grid(plane, step)
        yield from _map(cords, tests, points, step, length, count == FINE)


def sensor_of(found: NextCord, at: int, name: str, judge: LayoutJudge) -> Sensor:
    """The best cord through point `at`."""
    return StraightCords(judge.task, found.plane, ()).sensor(name, found.ends[at])


class AddedCord:
    """The expected error with one more cord than the `sensors` of a device."""

    def __init__(self, judge: LayoutJudge, sensors: Sequence[Sensor]) -> None:
        """Raises LayoutError for sensors of which nothing can be said."""
        task, quick = judge.task, judge.quick_tasks
        self._kinds = tuple(quick) or (_STAND_IN,)
        self._folds = task.unseen.folds
        problem = task.everything
        self._outputs = reduce_outputs(problem.markers, problem.marker_weights)
        if sensors:
            cords = assumed_cords(task, sensors)
            self._signals, self._noise = read(task, cords)
            tasks = quick or {_STAND_IN: task.with_decoder(_STAND_IN)}
            #: That of the sensors alone, mm.
            self.error = min(predict(t, cords).prediction.unseen for t in tasks.values())
            if not np.isfinite(self.error):
                raise LayoutError(
                    "nothing can be said of the cords that there are: do they leave the body?"
                )
        else:
            self._signals, self._noise = np.zeros((len(self._outputs), 0)), np.zeros(0)
            self.error = self._of_the_mean()

    def errors(self, signals: Float, noise: Float) -> Float:
        """RMSE (k,) mm with each of the cords of signals (n, k) and noise (k,) in turn."""
        outputs, folds = self._outputs, self._folds
        each = [
            unseen_errors(kind, folds, outputs, self._signals, self._noise, signals, noise)
            for kind in self._kinds
        ]
        return np.asarray(np.min(each, axis=0))

    def _of_the_mean(self) -> float:
        """Without any cord the mean position is all that is known."""
        square = sum(
            float(((self._outputs[test] - self._outputs[seen].mean(axis=0)) ** 2).sum())
            for seen, test in self._folds
        )
        return float(np.sqrt(square / sum(len(test) for _, test in self._folds)))


def _map(
    cords: StraightCords, tests: AddedCord, points: Float, step: float, length: float | None,
    fine: bool,
) -> Iterator[NextCord]:  # fmt: skip
    directions = cords.directions(DIRECTIONS)
    drop, ends = np.full(len(points), np.nan), np.zeros((len(points), 2, 3))
    at, tried = max(_CHUNK // DIRECTIONS, 1), 0
    for first in range(0, len(points), at):
        some = points[first : first + at]
        middle = np.repeat(some, DIRECTIONS, axis=0)
        along = np.tile(directions, (len(some), 1))
        if length is None:
            laid, good = cords.through(middle, along)
        else:
            laid, good = cords.short(middle, along, length)
        gain = np.full(len(laid), np.nan)
        if good.any():
            gain[good] = tests.error - tests.support.errors(*cords.read(laid[good]))
        tried += int(good.sum())
        best, which = _best_of_each(gain.reshape(len(some), DIRECTIONS))
        drop[first : first + at] = best
        ends[first : first + at] = laid[which]
        share = min((first + at) / len(points), 1.0)
        yield NextCord(
            cords.plane, step, points, drop.copy(), ends.copy(), tests.error, tried, share, fine
        )


def _best_of_each(gain: Float) -> tuple[Float, Int]:
    """Of gains (p, d), the best (p,) of each point, and which of all (p d) it is."""
    which = np.where(np.isnan(gain), -np.inf, gain).argmax(axis=1)
    rows = np.arange(len(gain))
    return gain[rows, which], rows * gain.shape[1] + which
