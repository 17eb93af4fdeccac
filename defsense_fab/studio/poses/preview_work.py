"""Shapes of poses, sought beside the page: the newest that was asked for counts."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from ...core.arrays import Float
from ...core.device.device import Device, Pose
from ...core.errors import DefsenseError
from ...core.mesh import TetMesh
from ...mechanics.solver.load_stepping import Status
from ...optimize.prediction.pose_preview import PosePreview, PreviewedPose, load_coarse_mesh
from ..workbench.latest_worker import LatestWorker

_TIMES = 500  # answers whose times are kept


@dataclass(frozen=True)
class Wanted:
    """A pose of a device at a share of its ramp; `check` where no hand moves it any more: then it
    is led to from rest, as a build does it; `quick` where a coarse shape is wanted before; `asked`
    is when that was (s of `time.perf_counter`)."""

    device: Device
    pose: Pose
    share: float = 1.0
    check: bool = False
    quick: bool = True
    asked: float = 0.0


@dataclass(frozen=True)
class Answer:
    """Vertices (v, 3) mm of the surface; of the fine mesh with what came of it, of the coarse one
    without; neither where there was none."""

    vertices: Float | None
    found: PreviewedPose | None


@dataclass(frozen=True)
class Times:
    """From a hand's message to vertices being sent, s; None where a newer one came before."""

    coarse: float | None
    fine: float | None


class PreviewWork:
    """`answered` hears of shapes, `solved` of the newest fine one with the solver that found it,
    `failed` of what cannot be; all on a thread of this."""

    def __init__(
        self,
        answered: Callable[[Wanted, Answer], None],
        solved: Callable[[PosePreview, Wanted, PreviewedPose], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self._answered, self._solved = answered, solved
        self._newest: object = None
        self._cancelled = 0.0
        self._lock = threading.Lock()
        self._preview: PosePreview | None = None
        self._other: list[PosePreview | None] = []  # of another build, not taken up yet
        self._coarse: list[tuple[PosePreview, TetMesh]] = []
        self.times: deque[Times] = deque(maxlen=_TIMES)
        self._work: LatestWorker[Wanted | Callable[[PosePreview], None]] = LatestWorker(
            self._do, failed
        )

    @property
    def has_coarse(self) -> bool:
        """Whether the next answer is a coarse one first."""
        with self._lock:
            preview = self._other[0] if self._other else self._preview
            waits = any(owner is preview for owner, _ in self._coarse)
            return preview is not None and (waits or preview.has_coarse)

    def begin(self, preview: PosePreview | None) -> None:
        """Go on with another build, or none; its coarse mesh is made meanwhile."""
        with self._lock:
            self._other = [preview]
        if preview is not None:
            threading.Thread(target=self._mesh, args=(preview,), daemon=True).start()

    def give(self, wanted: Wanted) -> None:
        """From any thread; returns at once."""
        self._newest = wanted
        self._work.give(wanted)

    def call(self, action: Callable[[PosePreview], None]) -> None:
        """Something longer with the solver, in its turn."""
        self._newest = action
        self._work.give(action)

    def is_newest(self, thing: object) -> bool:
        """Whether nothing was asked for since."""
        return self._newest is thing

    def cancel(self) -> None:
        """End what is being sought; the last shape stays."""
        self._cancelled = time.perf_counter()

    def cancelled_since(self, begun: float) -> bool:
        """Whether somebody cancelled since then (s of `time.perf_counter`)."""
        return self._cancelled > begun

    def wait(self, seconds: float) -> bool:
        """Whether all that was asked for is done within so many s."""
        return self._work.wait(seconds)

    def close(self) -> None:
        """End the thread."""
        self.cancel()
        self._work.close()

    def _mesh(self, preview: PosePreview) -> None:
        try:
            made = load_coarse_mesh(preview.device)
        except (DefsenseError, OSError):  # fine answers alone, which come later
            made = None
        if made is not None:
            with self._lock:
                self._coarse = [(preview, made)]

    def _do(self, thing: Wanted | Callable[[PosePreview], None]) -> None:
        preview = self._ready()
        if preview is None:
            return
        if not isinstance(thing, Wanted):
            thing(preview)
            return
        begun = time.perf_counter()
        preview.take(thing.device)
        rest, sent = preview.surface.vertices, list[float]()

        def coarse(moved: Float) -> None:
            self._answered(thing, Answer(rest + moved, None))
            sent.append(time.perf_counter() - thing.asked)

        found = preview.edit(
            thing.pose, thing.share, coarse if thing.quick else None,
            lambda: self.cancelled_since(begun), lambda: not self.is_newest(thing),
            check=thing.check, from_rest=thing.check,
        )  # fmt: skip
        shape = None if found.moved is None else rest + found.moved
        if found.status is not Status.CANCELLED or self.is_newest(thing):
            self._answered(thing, Answer(shape, found))
        fine = None if shape is None else time.perf_counter() - thing.asked
        self.times.append(Times(sent[0] if sent else None, fine))
        if self.is_newest(thing):
            self._solved(preview, thing, found)

    def _ready(self) -> PosePreview | None:
        with self._lock:
            if self._other:
                if self._preview is not None:
                    self._preview.close()
                self._preview = self._other.pop()
            for preview, made in self._coarse:
                if preview is self._preview:
                    preview.take_coarse(made)
            if self._preview is not None:
                self._coarse = [c for c in self._coarse if c[0] is not self._preview]
        return self._preview
