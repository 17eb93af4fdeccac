"""What cords would sense, before anything is built of them: within milliseconds, for a person who
draws them."""

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
from .design_task import SEED, DesignTask, decoders, load_task
from .predict import predict

_ENDS = 8.0  # mm, of a straight run at either end of a new path
_POINTS = 4  # between them
_SLOW = "kernel"
_STEPS = 400  # samples of a line through the body
#: Told the share that is done, and what is done now.
Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Judged:
    """The error (mm) that is expected of cords on states that they are not designed for, by the
    best of the decoders that the device may have, and its name; the error in each state; signals
    (n, c) in the states `names` (n,)."""

    error: float
    decoder: str
    per_state: Mapping[str, float]
    names: tuple[str, ...]
    signals: Float


class LayoutJudge:
    """Of a device whose poses are simulated in the build `folder`."""

    def __init__(self, device: Device, folder: Path) -> None:
        """Raises a DefsenseError where the poses are not simulated."""
        build = Build(folder)
        self._task: DesignTask = load_task(device, build)
        kinds = decoders(device, self._task)
        self._tasks = {kind: self._task.with_decoder(kind) for kind in kinds}
        self.surface = build.surface
        self._depth = SignedDistance(self.surface)

    @property
    def task(self) -> DesignTask:
        """What the cords are judged by."""
        return self._task

    @property
    def quick_tasks(self) -> dict[str, DesignTask]:
        """The same for each of the decoders that are fast, by name."""
        return {kind: task for kind, task in self._tasks.items() if kind != _SLOW}

    def judge(self, sensors: Sequence[Sensor], *, quick: bool = False) -> Judged | None:
        """None without cords; `quick`: within some 20 ms, without the decoder that takes ten times
        as long, unless there is no other. Raises LayoutError for cords of which nothing can be
        said."""
        if not sensors:
            return None
        cords = assumed_cords(self._task, sensors)
        tasks = (self.quick_tasks if quick else {}) or self._tasks
        scored = [predict(task, cords) for task in tasks.values()]
        best = min(scored, key=lambda s: s.prediction.unseen)
        p = best.prediction
        if not np.isfinite(p.unseen):
            raise LayoutError("nothing can be said of these cords: do they leave the body?")
        return Judged(
            p.unseen, p.decoder, {**p.per_state, **p.held_out}, self._task.names, best.signals
        )

    def check(self, sensors: Sequence[Sensor]) -> LayoutCheck:
        """Lengths, radii, walls and distances, and what they break."""
        return verify(sensors, self.surface, self._task.design.limits, self._depth)

    def propose(self, name: str, sensors: Sequence[Sensor], report: Report) -> Sensor:
        """The cord that lowers the error most beside those that there are, which stay; found by the
        search of the optimise stage within a second or two. Raises LayoutError where none has room,
        and what `report` raises, which ends it."""
        kept = [replace(s, free=frozenset()) for s in sensors]
        kinds = [k for k in self._tasks if k != _SLOW] or list(self._tasks)
        found = []
        for n, kind in enumerate(kinds):
            task = self._tasks[kind]
            show = partial(report_part, report, n / len(kinds), (n + 1) / len(kinds))
            rng = np.random.default_rng(SEED)
            layout = optimize_layout(task.design, kept, rng, show, extra=1).sensors
            error = predict(task, assumed_cords(task, layout)).prediction.unseen
            found.append((error, n, layout[-1]))
        return replace(min(found)[2], name=name, free=frozenset({"path", "plane"}))

    def new_cord(self, name: str) -> Sensor:
        """A straight cord along the body, through its middle, in the plane in which it is widest.
        Raises LayoutError where none has room."""
        plane = middle_plane(self.surface)
        half = float(np.ptp(self.surface.vertices, axis=0).max()) / 2
        along = np.linspace(-half, half, _STEPS)
        depth = self._task.everything.depth(plane.origin + along[:, None] * plane.axes[:, 0])
        inside = along[depth >= self._task.design.limits.depth]
        if not len(inside) or np.ptp(inside) < 2 * _ENDS + 1:
            raise LayoutError("a straight cord along the body has no room in it; draw its plane")
        # Its ends leave the body as they come, so that only walls beside it count.
        first, last = along[depth > 0][[0, -1]] + [1.0, -1.0]
        between = np.linspace(first + _ENDS, last - _ENDS, _POINTS)
        points = np.array([[p, 0.0] for p in (first, *between, last)])
        return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset({"path"}))
