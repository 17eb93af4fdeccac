"""Pools of candidate cords by the thousand: screened, and their signals in one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Sensor
from ...mechanics.elements.threads import cores, over_chunks
from ..problem.problem import Problem
from .candidate_batch import COARSE, Batch
from .screening import feasible


@dataclass(frozen=True)
class Pool:
    """Feasible candidates for one cord, batch after batch: paths (c, p, 3) mm, signals (n, c)."""

    batches: tuple[Batch, ...]
    paths: Float
    signals: Float

    def __len__(self) -> int:
        return len(self.paths)

    @classmethod
    def of(cls, problem: Problem, sensor: Sensor) -> Pool:
        """A pool of one."""
        plane, curve = sensor.plane, sensor.curve
        arrays = (plane.origin, plane.axes, curve.points, curve.tangents)
        batch = Batch(sensor, *(a[None] for a in arrays))
        paths = batch.paths(COARSE)
        return cls((batch,), paths, problem.signals(paths))

    @classmethod
    def empty(cls, problem: Problem) -> Pool:
        """A pool without candidates."""
        return cls((), np.zeros((0, COARSE, 3)), np.zeros((len(problem.markers), 0)))

    def sensor(self, i: int, name: str, free: frozenset[str]) -> Sensor:
        """Candidate i."""
        for batch in self.batches:
            if i < len(batch):
                return replace(batch.sensor(i), name=name, free=free)
            i -= len(batch)
        raise IndexError(i)

    def plus(self, other: Pool) -> Pool:
        """This pool and another."""
        return Pool(
            self.batches + other.batches,
            np.concatenate([self.paths, other.paths]),
            np.concatenate([self.signals, other.signals], axis=1),
        )


def build_pool(
    problem: Problem, makers: Sequence[Callable[[], Batch]], keep_first: bool = False
) -> Pool:
    """Candidates that keep the limits, of all makers, and their signals; `keep_first` keeps the
    very first even if it does not. Makers run on all cores."""
    kept: list[Batch] = [None] * len(makers)  # type: ignore[list-item]
    problem.grid, problem.depth, problem.carrier  # noqa: B018 - made once, for all threads

    def work(start: int, stop: int) -> None:
        for n in range(start, stop):
            batch = makers[n]()
            which = feasible(batch, problem.depth, problem.grid, problem.limits)
            if keep_first and n == 0:
                which = np.union1d([0], which)
            kept[n] = batch.take(which)

    over_chunks(work, len(makers), cores(), 1)
    paths = np.concatenate([np.zeros((0, COARSE, 3)), *(b.paths(COARSE) for b in kept)])
    return Pool(tuple(kept), paths, problem.signals(paths))
