"""Map where in a plane one more cord would help most.

Through each point of a grid straight cords are placed in several directions. Each cord that fits is
added to the present cords, and the best one counts. The error is that of a quick
`LayoutJudge.judge`: on states that the decoder was not trained on, by the better of the fast
decoders.
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
from ...optimization.prediction.as_built import assumed_cords
from ...optimization.prediction.design_task import DesignTask
from ...optimization.prediction.predict import predict_with_best_decoder, read_cords
from ...optimization.problem.problem import reduce_outputs
from .body_section import BodySection
from .layout_judge import LayoutJudge
from .straight_cords import StraightCords

DIRECTIONS = 8
COARSE_POINTS, FINE_POINTS = 100, 600  # of the two grids, approximately
_SUBSTITUTE_DECODER = "quadratic"  # for decoders too slow to be fitted thousands of times
_SHORT_CORD_MM = 30.0
_CHUNK_CORDS = 300  # tried at once, before the caller can cancel


@dataclass(frozen=True)
class NextCord:
    """The map of the next cord, as far as it is computed.

    Attributes:
        plane: The plane.
        step: Distance of neighboring points, mm.
        points: (p, 3) mm, points of the grid.
        drop: (p,) mm, by how much the best cord through each point lowers the error; NaN where no
            cord fits.
        ends: (p, 2, 3) mm, ends of that cord.
        error: Error of the present cords, mm.
        tried: Number of cords that were tried.
        share: Share of the grid that is done.
        is_fine: Whether the grid is the fine one.
    """

    plane: Plane
    step: float
    points: Float
    drop: Float
    ends: Float
    error: float
    tried: int
    share: float
    is_fine: bool

    @property
    def best(self) -> int | None:
        """Number of the point whose cord lowers the error most, None if no cord lowers it."""
        if np.isnan(self.drop).all() or np.nanmax(self.drop) <= 0:
            return None
        return int(np.nanargmax(self.drop))

    @property
    def best_drop(self) -> float:
        """Largest decrease of the error, mm; 0 if no cord lowers it."""
        return 0.0 if self.best is None else float(self.drop[self.best])

    @property
    def best_ends(self) -> Float | None:
        """Ends (2, 3) mm of the best cord, None if no cord lowers the error."""
        return None if self.best is None else np.asarray(self.ends[self.best])


def shortest_cord(task: DesignTask) -> float:
    """Return the length (mm) of a short cord: 30, or more if the limits require it."""
    return max(_SHORT_CORD_MM, float(np.ceil(task.design.limits.shortest)))


def map_next_cord(
    judge: LayoutJudge,
    body: BodySection,
    plane: Plane,
    sensors: Sequence[Sensor],
    length: float | None,
) -> Iterator[NextCord]:
    """Map where one more cord would help, on a coarse grid and then on a fine one.

    Args:
        judge: Judge of the device.
        body: Sections of the body.
        plane: The plane of the new cord.
        sensors: The present cords.
        length: Length of the new cord, mm; None for cords from skin to skin.

    Yields:
        The map as far as it is computed. To cancel, stop iterating.

    Raises:
        LayoutError: If the plane misses the body, or present cords leave it.
    """
    area = body.cut(plane).area
    added_cord = AddedCord(judge, sensors)
    cords = StraightCords(judge.task, plane, sensors)
    for count in (COARSE_POINTS, FINE_POINTS):
        step = max(float(np.sqrt(area / count)), 0.5)
        points, _ = body.grid(plane, step)
        yield from _map_points(cords, added_cord, points, step, length, count == FINE_POINTS)


def best_sensor(cord_map: NextCord, at: int, name: str, judge: LayoutJudge) -> Sensor:
    """Return the best cord through a point of a map.

    Args:
        cord_map: The map.
        at: Number of the point.
        name: Name of the cord.
        judge: Judge of the device.
    """
    return StraightCords(judge.task, cord_map.plane, ()).sensor(name, cord_map.ends[at])


class AddedCord:
    """Predicts the error of a device with one more cord.

    Args:
        judge: Judge of the device.
        sensors: The present cords.

    Attributes:
        error: Error (mm) of the present cords.

    Raises:
        LayoutError: If no error can be predicted for the present cords.
    """

    def __init__(self, judge: LayoutJudge, sensors: Sequence[Sensor]) -> None:
        task, quick = judge.task, judge.quick_tasks
        self._kinds = tuple(quick) or (_SUBSTITUTE_DECODER,)
        self._folds = task.unseen.folds
        problem = task.everything
        self._outputs = reduce_outputs(problem.markers, problem.marker_weights)
        if sensors:
            cords = assumed_cords(task, sensors)
            self._signals, self._noise = read_cords(task, cords)
            tasks = quick or {_SUBSTITUTE_DECODER: task.with_decoder(_SUBSTITUTE_DECODER)}
            scored = predict_with_best_decoder(tuple(tasks.values()), cords)[1]
            self.error = scored.prediction.unseen
            if not np.isfinite(self.error):
                raise LayoutError(
                    "no error can be predicted for the present cords",
                    code="not-finite",
                    action="Check that they lie inside the body",
                )
        else:
            self._signals, self._noise = np.zeros((len(self._outputs), 0)), np.zeros(0)
            self.error = self._error_of_mean()

    def errors(self, signals: Float, noise: Float) -> Float:
        """Return the RMSE (k,) mm with each of k new cords in turn.

        Args:
            signals: Signals (n, k) of the new cords.
            noise: Their noise (k,).
        """
        outputs, folds = self._outputs, self._folds
        each = [
            unseen_errors(kind, folds, outputs, self._signals, self._noise, signals, noise)
            for kind in self._kinds
        ]
        return np.asarray(np.min(each, axis=0))

    def _error_of_mean(self) -> float:
        """Return the error (mm) of the mean positions, the best guess without cords."""
        square = sum(
            float(((self._outputs[test] - self._outputs[train].mean(axis=0)) ** 2).sum())
            for train, test in self._folds
        )
        return float(np.sqrt(square / sum(len(test) for _, test in self._folds)))


def _map_points(
    cords: StraightCords,
    added_cord: AddedCord,
    points: Float,
    step: float,
    length: float | None,
    is_fine: bool,
) -> Iterator[NextCord]:
    directions = cords.directions(DIRECTIONS)
    drop, ends = np.full(len(points), np.nan), np.zeros((len(points), 2, 3))
    chunk, tried = max(_CHUNK_CORDS // DIRECTIONS, 1), 0
    for first in range(0, len(points), chunk):
        chunk_points = points[first : first + chunk]
        middle = np.repeat(chunk_points, DIRECTIONS, axis=0)
        along = np.tile(directions, (len(chunk_points), 1))
        if length is None:
            placed, fits = cords.through(middle, along)
        else:
            placed, fits = cords.short(middle, along, length)
        gain = np.full(len(placed), np.nan)
        if fits.any():
            gain[fits] = added_cord.error - added_cord.errors(*cords.read(placed[fits]))
        tried += int(fits.sum())
        best, which = _best_per_point(gain.reshape(len(chunk_points), DIRECTIONS))
        drop[first : first + chunk] = best
        ends[first : first + chunk] = placed[which]
        share = min((first + chunk) / len(points), 1.0)
        yield NextCord(
            cords.plane,
            step,
            points,
            drop.copy(),
            ends.copy(),
            added_cord.error,
            tried,
            share,
            is_fine,
        )


def _best_per_point(gain: Float) -> tuple[Float, Int]:
    """Return the best (p,) of gains (p, d) for each point, and its index among all p d."""
    which = np.where(np.isnan(gain), -np.inf, gain).argmax(axis=1)
    rows = np.arange(len(gain))
    return gain[rows, which], rows * gain.shape[1] + which
