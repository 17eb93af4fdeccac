"""Judge cords within milliseconds while a person draws them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, catmull_rom, distinct_planes
from ...core.device.device import Device, Sensor
from ...core.errors import LayoutError
from ...core.progress import Report, subrange
from ...geometry.kernels.surface_queries import SignedDistance
from ...optimization.limits.verification import LayoutCheck as LayoutCheck
from ...optimization.limits.verification import verify
from ...optimization.prediction.as_built import assumed_cords
from ...optimization.prediction.design_task import SEED, DesignTask, candidate_decoders, load_task
from ...optimization.prediction.predict import predict, predict_with_best_decoder
from ...optimization.refinement.refine import optimize_layout
from ...optimization.search.baselines import middle_plane
from ...optimization.search.plane_directions import face_directions
from ...optimization.search.starting_layouts import LayoutSearch
from ...store.build import Build

_STRAIGHT_END_MM = 8.0  # of a new path
_INNER_POINTS = 4  # control points between the straight ends
_SLOW_DECODER = "kernel"
_LINE_SAMPLES = 400  # of a line through the body
#: Correlation of two cords' signals above which one of them adds hardly any information.
_REDUNDANT_CORRELATION = 0.95


@dataclass(frozen=True)
class JudgedLayout:
    """The expected performance of cords.

    Attributes:
        error: RMSE (mm) on unseen states with the best of the device's decoders.
        decoder: Name of that decoder.
        pose_errors: Error (mm) in each pose at its largest simulated level, by the pose's name.
        pose_movements: Root mean square of the markers' movement (mm) in the same states.
        pose_travels: Largest movement of a marker (mm) in the same states.
        pose_signals: (c,) signals of the cords in the same states, by the pose's name.
        signals: (n, c) signals of the cords in all states, rest first.
    """

    error: float
    decoder: str
    pose_errors: Mapping[str, float]
    pose_movements: Mapping[str, float]
    pose_travels: Mapping[str, float]
    pose_signals: Mapping[str, Float]
    signals: Float


@dataclass(frozen=True)
class CordComparison:
    """Two cords of a layout next to each other.

    Attributes:
        names: The two cords.
        errors_without: Expected error of the layout without each of them, mm; None if no cord
            would be left.
        error: Expected error of the whole layout, mm.
        largest_signals: Largest absolute relative change of resistance of each cord.
        correlation: Pearson correlation of their signals over all states, 0 if one is constant.
    """

    names: tuple[str, str]
    errors_without: tuple[float | None, float | None]
    error: float
    largest_signals: tuple[float, float]
    correlation: float

    @property
    def is_redundant(self) -> bool:
        """Whether one of the cords adds hardly any information."""
        return abs(self.correlation) > _REDUNDANT_CORRELATION


class LayoutJudge:
    """Judges cords of a device whose poses are simulated.

    Args:
        device: The device.
        build: Its build.

    Attributes:
        surface: The body's surface.

    Raises:
        DefsenseError: If the poses are not simulated.
    """

    def __init__(self, device: Device, build: Build) -> None:
        self._task: DesignTask = load_task(device, build)
        self._largest_states = _largest_states(self._task.weights)
        markers = self._task.everything.markers
        distances = np.linalg.norm(markers - markers[:1], axis=2)
        self._movements: list[float] = np.sqrt((distances**2).mean(axis=1)).tolist()
        self._travels: list[float] = distances.max(axis=1).tolist()
        kinds = candidate_decoders(device, self._task)
        self._tasks = {kind: self._task.with_decoder(kind) for kind in kinds}
        self.surface = build.surface
        self._depth = SignedDistance(self.surface)

    @property
    def task(self) -> DesignTask:
        """Design task that the cords are judged by."""
        return self._task

    @property
    def quick_tasks(self) -> dict[str, DesignTask]:
        """Design task of each fast decoder, by name."""
        return {kind: task for kind, task in self._tasks.items() if kind != _SLOW_DECODER}

    def judge(self, sensors: Sequence[Sensor], *, quick: bool = False) -> JudgedLayout | None:
        """Predict the error of cords.

        Args:
            sensors: The cords.
            quick: Take about 20 ms, without the decoder that takes ten times as long unless there
                is no other.

        Returns:
            The expected performance, or None without cords.

        Raises:
            LayoutError: If the predicted error is not finite.
        """
        if not sensors:
            return None
        cords = assumed_cords(self._task, sensors)
        tasks = (self.quick_tasks if quick else {}) or self._tasks
        _, best = predict_with_best_decoder(tuple(tasks.values()), cords)
        p = best.prediction
        if not np.isfinite(p.unseen):
            raise LayoutError(
                "no error can be predicted for these cords",
                code="not-finite",
                action="Check that they lie inside the body",
            )
        errors, names = {**p.per_state, **p.held_out}, self._task.names
        largest = {pose: k for pose, k in self._largest_states.items() if names[k] in errors}
        return JudgedLayout(
            p.unseen,
            p.decoder,
            {pose: errors[names[k]] for pose, k in largest.items()},
            {pose: self._movements[k] for pose, k in largest.items()},
            {pose: self._travels[k] for pose, k in largest.items()},
            {pose: best.signals[k] for pose, k in largest.items()},
            best.signals,
        )

    def compare(
        self, sensors: Sequence[Sensor], judged: JudgedLayout, names: tuple[str, str]
    ) -> CordComparison:
        """Compare two cords of a layout: the error without each, and how alike they sense.

        Args:
            sensors: All cords of the layout.
            judged: Prediction for all cords.
            names: The two cords.
        """
        first, second = (
            self.judge([s for s in sensors if s.name != name], quick=True) for name in names
        )
        signals = judged.signals[:, [[s.name for s in sensors].index(name) for name in names]]
        largest = np.abs(signals).max(axis=0)
        return CordComparison(
            names,
            (None if first is None else first.error, None if second is None else second.error),
            judged.error,
            (float(largest[0]), float(largest[1])),
            _correlation(signals),
        )

    def check(self, sensors: Sequence[Sensor]) -> LayoutCheck:
        """Measure lengths, radii, walls and distances, and find broken limits."""
        return verify(sensors, self.surface, self._task.design.limits, self._depth)

    def proposals(self, name: str, sensors: Sequence[Sensor], report: Report) -> Iterator[Sensor]:
        """Yield cords to add, each from a search of a second or two, the most accurate first.

        The first search is free; the later ones have other random candidates, planes along the
        body's faces, or the planes of the cords that stay, whose parts are simpler.

        Args:
            name: Name of the new cord.
            sensors: Cords that stay.
            report: Called with the progress; what it raises, unless it is a LayoutError, ends the
                search.

        Raises:
            LayoutError: If the body has no room for another cord.
        """
        fixed = [replace(s, free=frozenset()) for s in sensors]
        planes = len(distinct_planes([s.plane for s in fixed if s.curve.is_planar]))
        searches = [(SEED, LayoutSearch(extra=1)), (SEED + 1, LayoutSearch(extra=1))]
        searches.append((SEED, LayoutSearch(extra=1, normals=face_directions(self.surface))))
        if planes:
            searches.append((SEED, LayoutSearch(extra=1, planes=planes)))
        for k, (seed, search) in enumerate(searches):
            show = subrange(report, k / len(searches), (k + 1) / len(searches))
            try:
                yield replace(
                    self._propose(fixed, search, seed, show),
                    name=name,
                    free=frozenset({"path", "plane"}),
                )
            except LayoutError:
                if k == 0:
                    raise

    def _propose(
        self, fixed: Sequence[Sensor], search: LayoutSearch, seed: int, report: Report
    ) -> Sensor:
        """Return the best cord of a search with each fast decoder."""
        kinds = [k for k in self._tasks if k != _SLOW_DECODER] or list(self._tasks)
        proposals = []
        for n, kind in enumerate(kinds):
            task = self._tasks[kind]
            show = subrange(report, n / len(kinds), (n + 1) / len(kinds))
            rng = np.random.default_rng(seed)
            layout = optimize_layout(task.design, fixed, rng, show, search).sensors
            error = predict(task, assumed_cords(task, layout)).prediction.unseen
            proposals.append((error, n, layout[-1]))
        return min(proposals)[2]

    def new_cord(self, name: str) -> Sensor:
        """Create a straight cord along the body, through its middle, in its widest plane.

        Raises:
            LayoutError: If there is no room for it.
        """
        plane = middle_plane(self.surface)
        half = float(np.ptp(self.surface.vertices, axis=0).max()) / 2
        along = np.linspace(-half, half, _LINE_SAMPLES)
        depth = self._task.everything.depth(plane.origin + along[:, None] * plane.axes[:, 0])
        inside = along[depth >= self._task.design.limits.depth]
        if not len(inside) or np.ptp(inside) < 2 * _STRAIGHT_END_MM + 1:
            raise LayoutError(
                "a straight cord along the body has no room in it",
                code="no-room-for-cords",
                action="Draw its plane",
                count=1,
            )
        # Its ends leave the body straight, so that only the walls next to it matter.
        first, last = along[depth > 0][[0, -1]] + [1.0, -1.0]
        between = np.linspace(first + _STRAIGHT_END_MM, last - _STRAIGHT_END_MM, _INNER_POINTS)
        points = np.array([[p, 0.0] for p in (first, *between, last)])
        return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset({"path"}))


def _largest_states(weights: Sequence[Mapping[str, float]]) -> dict[str, int]:
    """Return the index of the state with each pose alone at its largest level, by pose."""
    largest: dict[str, tuple[float, int]] = {}
    for k, state in enumerate(weights):
        acting = [(pose, weight) for pose, weight in state.items() if weight]
        if len(acting) == 1:
            pose, weight = acting[0]
            if weight > largest.get(pose, (-1.0, 0))[0]:
                largest[pose] = weight, k
    return {pose: k for pose, (_, k) in largest.items()}


def _correlation(signals: Float) -> float:
    """Return the correlation of two columns, 0 if one of them is constant."""
    deviations = signals - signals.mean(axis=0)
    norms = np.linalg.norm(deviations, axis=0)
    if not norms.all():
        return 0.0
    return float(deviations[:, 0] @ deviations[:, 1] / norms.prod())
