"""Judge cords within milliseconds while a person draws them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, catmull_rom
from ...core.device.device import Device, Sensor
from ...core.errors import LayoutError
from ...geometry.kernels.surface_queries import SignedDistance
from ...store.build import Build
from ..limits.verification import LayoutCheck, verify
from ..refinement.refine import optimize_layout, report_part
from ..search.baselines import middle_plane
from .as_built import assumed_cords
from .design_task import SEED, DesignTask, candidate_decoders, load_task
from .predict import predict

_STRAIGHT_END_MM = 8.0  # of a new path
_INNER_POINTS = 4  # control points between the straight ends
_SLOW_DECODER = "kernel"
_LINE_SAMPLES = 400  # of a line through the body
#: Called with the share of the work done and a description.
Report = Callable[[float, str], None]


@dataclass(frozen=True)
class JudgedLayout:
    """The expected performance of cords.

    Attributes:
        error: RMSE (mm) on unseen states with the best of the device's decoders.
        decoder: Name of that decoder.
        per_state: Error (mm) in each state, by name.
        names: (n,) names of all states, rest first.
        signals: (n, c) signals of the cords.
    """

    error: float
    decoder: str
    per_state: Mapping[str, float]
    names: tuple[str, ...]
    signals: Float


class LayoutJudge:
    """Judges cords of a device whose poses are simulated.

    Args:
        device: The device.
        folder: Folder of its build.

    Attributes:
        surface: The body's surface.

    Raises:
        DefsenseError: If the poses are not simulated.
    """

    def __init__(self, device: Device, folder: Path) -> None:
        build = Build(folder)
        self._task: DesignTask = load_task(device, build)
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
            LayoutError: If no error can be predicted, as for cords outside the body.
        """
        if not sensors:
            return None
        cords = assumed_cords(self._task, sensors)
        tasks = (self.quick_tasks if quick else {}) or self._tasks
        scored = [predict(task, cords) for task in tasks.values()]
        best = min(scored, key=lambda s: s.prediction.unseen)
        p = best.prediction
        if not np.isfinite(p.unseen):
            raise LayoutError(
                "no error can be predicted for these cords",
                code="error-not-finite",
                action="Check that they lie inside the body",
            )
        return JudgedLayout(
            p.unseen, p.decoder, {**p.per_state, **p.held_out}, self._task.names, best.signals
        )

    def check(self, sensors: Sequence[Sensor]) -> LayoutCheck:
        """Measure lengths, radii, walls and distances, and find broken limits."""
        return verify(sensors, self.surface, self._task.design.limits, self._depth)

    def propose(self, name: str, sensors: Sequence[Sensor], report: Report) -> Sensor:
        """Find the additional cord that lowers the error most, within a second or two.

        Args:
            name: Name of the new cord.
            sensors: Cords that stay.
            report: Called with the progress; what it raises ends the search.

        Raises:
            LayoutError: If the body has no room for another cord.
        """
        fixed = [replace(s, free=frozenset()) for s in sensors]
        kinds = [k for k in self._tasks if k != _SLOW_DECODER] or list(self._tasks)
        proposals = []
        for n, kind in enumerate(kinds):
            task = self._tasks[kind]
            show = partial(report_part, report, n / len(kinds), (n + 1) / len(kinds))
            rng = np.random.default_rng(SEED)
            layout = optimize_layout(task.design, fixed, rng, show, extra=1).sensors
            error = predict(task, assumed_cords(task, layout)).prediction.unseen
            proposals.append((error, n, layout[-1]))
        return replace(min(proposals)[2], name=name, free=frozenset({"path", "plane"}))

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
