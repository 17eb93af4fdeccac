"""Searches for cords of one device, which run at the same time: in processes, or on a cluster.

Each search has its own random numbers, so its result does not depend on where it runs.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import LayoutError
from ...core.machine.parallel_tasks import map_in_processes
from ...core.machine.processes import one_blas_thread
from ...core.progress import describe_duration
from ...mechanics.elements.threads import count_cores
from ...optimization.problem.problem import Problem
from ...optimization.refinement.refine import OptimizedLayout, optimize_layout
from ...optimization.search.starting_layouts import Layout, LayoutSearch
from .cluster import stop_if_cancelled
from .stages import Report, SearchProgress, Watch

#: Expected time of the searches in one process from which another is worth its start, s. On two
#: cores the bar (8 s of searches) gained nothing, and a build of the character took 50, not 61 s.
_MIN_PARALLEL_S = 12.0

#: Calls a function of a task and shared data for each task elsewhere, and yields the index and
#: result of each finished task, as `cluster.map_on_cluster` does.
MapTasks = Callable[
    [Callable[[Any, Any], Any], Sequence[Any], Any], Generator[tuple[int, Any], None, None]
]


@dataclass(frozen=True)
class Search:
    """One search for cords.

    Attributes:
        decoder: Kind of the decoder.
        seed: Number of the search, which adds to the seed of the device.
        planes: Largest number of planes; None for no limit.
        normals: Normals (k, 3) of the planes; None for any.
    """

    decoder: str
    seed: int
    planes: int | None
    normals: Float | None = None

    @property
    def name(self) -> str:
        """Name for people."""
        return f"search {self.seed + 1}"


class SearchObserver:
    """Callbacks of a search for the best layout so far and every step; None without `watch`."""

    def __init__(self, folder: Path, watch: Watch | None) -> None:
        self.kept = None if watch is None else self._callback(folder, watch, kept=True)
        self.passed = None if watch is None else self._callback(folder, watch, kept=False)

    @staticmethod
    def _callback(folder: Path, watch: Watch, *, kept: bool) -> Callable[[Layout, float], None]:
        return lambda layout, rmse: watch(SearchProgress(folder, tuple(layout), rmse, kept))


class SearchRunner:
    """Runs the searches of a device.

    Args:
        device: The device.
        problem: The problem, for any decoder.
        observer: Callbacks; with them, and without a cluster, all searches run one after another in
            this process.
        map_tasks: Runs the searches on a cluster; None for this machine.
    """

    def __init__(
        self,
        device: Device,
        problem: Problem,
        observer: SearchObserver,
        map_tasks: MapTasks | None = None,
    ) -> None:
        self._device, self._problem = device, problem
        self._observer, self._map_tasks = observer, map_tasks
        self._seconds: float | None = None  # of a search

    def run(
        self, searches: Sequence[Search], report: Report
    ) -> list[OptimizedLayout | LayoutError]:
        """Return the layout of each search, or why it found none.

        Args:
            searches: The searches.
            report: Receives the completed fraction and a message.
        """
        results: dict[int, OptimizedLayout | LayoutError] = {}
        started_at, count = time.monotonic(), len(searches)

        def search_here(i: int) -> OptimizedLayout | LayoutError:
            search_started_at = time.monotonic()
            result = self._search_here(
                searches[i], lambda part, what: report((len(results) + part) / count, what)
            )
            self._seconds = time.monotonic() - search_started_at
            return result

        shared = self._device, self._problem
        if self._map_tasks is not None:
            finished = self._map_tasks(run_search, searches, shared)
        else:
            processes = self._count_processes(count)
            finished = map_in_processes(run_search, searches, shared, processes, search_here)
        with contextlib.closing(finished):  # its processes end with it
            for i, result in finished:
                if isinstance(result, Exception) and not isinstance(result, LayoutError):
                    raise result
                results[i] = result
                seconds = (time.monotonic() - started_at) / len(results) * (count - len(results))
                left = f", about {describe_duration(seconds)} left" if seconds >= 1 else ""
                report(len(results) / count, f"{len(results)} of {count} searches{left}")
        return [results[i] for i in range(count)]

    def _search_here(self, search: Search, report: Report) -> OptimizedLayout | LayoutError:
        if self._problem.decoder != search.decoder:  # shares what is already computed
            self._problem = self._problem.with_decoder(search.decoder)
        return _search(self._device, self._problem, search, report, self._observer)

    def _count_processes(self, count: int) -> int:
        """Return the number of processes for so many searches that is worth their start."""
        if self._observer.kept or self._seconds is None or count * self._seconds < _MIN_PARALLEL_S:
            return 1
        limit = os.environ.get("OMP_NUM_THREADS", "")  # set where other builds use other cores
        return min(count_cores(), int(limit)) if limit.isdecimal() else count_cores()


def run_search(search: Search, shared: tuple[Device, Problem]) -> OptimizedLayout | LayoutError:
    """Run a search in another process, or on a worker of a cluster.

    Args:
        search: The search.
        shared: The device, and the problem for any decoder.

    Returns:
        The layout, or why there is none.
    """
    device, problem = shared
    if problem.decoder != search.decoder:
        problem = problem.with_decoder(search.decoder)
    with one_blas_thread():
        return _search(device, problem, search, stop_if_cancelled())


def _search(
    device: Device,
    problem: Problem,
    search: Search,
    report: Report,
    observer: SearchObserver | None = None,
) -> OptimizedLayout | LayoutError:
    try:
        return optimize_layout(
            problem,
            device.sensors,
            np.random.default_rng((device.seed, search.seed)),
            report,
            LayoutSearch(
                extra=device.propose,
                planes=search.planes,
                normals=search.normals,
                in_space=device.cord.trace is not None,
            ),
            watch=observer.kept if observer else None,
            follow=observer.passed if observer else None,
        )
    except LayoutError as error:
        return error
