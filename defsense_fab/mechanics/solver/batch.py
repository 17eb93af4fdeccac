"""Solve many poses on all cores; each thread reuses its factorization for similar conditions."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from ..elements.material import Material
from ..elements.tet10 import QuadraticMesh
from ..elements.threads import count_cores
from ..loading.boundary_conditions import BoundaryConditions, rest_state
from .load_stepping import (
    Equilibrium,
    Stepping,
    confirm_equilibria,
    continue_from_free,
    follow,
)
from .newton import System

#: Usual states take 1 to 10 factorizations, states that buckle up to 30.
STATE_BUDGET = 100


@dataclass(frozen=True)
class Job:
    """A pose to solve.

    Attributes:
        conditions: Boundary conditions at the full amplitude.
        fractions: Increasing fractions of the way from rest of the requested equilibria.
        name: Name for people.
        budget: Number of factorizations after which one of the equilibria is given up.
    """

    conditions: BoundaryConditions
    fractions: tuple[float, ...]
    name: str = ""
    budget: int = STATE_BUDGET


#: Takes what `solve_all` takes but the threads, and returns the same.
Solve = Callable[..., list[list[Equilibrium]]]


def solve_all(
    mesh: QuadraticMesh,
    material: Material,
    jobs: Sequence[Job],
    on_step: Callable[[int, float], None] | None = None,
    threads: int | None = None,
    on_solved: Callable[[int, list[Equilibrium]], None] | None = None,
) -> list[list[Equilibrium]]:
    """Solve all jobs; results depend on the number of threads by rounding alone (1e-13 mm).

    If the caller is interrupted or a job raises, the other jobs are cancelled first.

    Args:
        mesh: Mesh of the body.
        material: Its material.
        jobs: Poses to solve.
        on_step: Called from the threads with the number of a job and the fraction it has reached.
        threads: Number of threads; all cores by default.
        on_solved: Called from the threads with the number of a job and its result.

    Returns:
        For each job the equilibria at its fractions, as `load_stepping.follow`,
        `confirm_equilibria` and `continue_from_free` return them.
    """
    total = threads or count_cores()
    workers = max(1, min(total, len(jobs)))
    share = max(1, total // workers)  # of the threads, for each worker
    waiting = sorted(range(len(jobs)), key=lambda i: jobs[i].conditions.structure.__repr__())
    lock, is_cancelled = threading.Lock(), threading.Event()
    results: list[list[Equilibrium]] = [[] for _ in jobs]

    def take(structure: object) -> int | None:
        """Take the next job, if possible one that fits the thread's factorization."""
        with lock:
            if not waiting or is_cancelled.is_set():
                return None
            same = [i for i in waiting if jobs[i].conditions.structure == structure]
            chosen = same[0] if same else waiting[0]
            waiting.remove(chosen)
            return chosen

    def work() -> None:
        system: System | None = None
        try:
            while (i := take(system.structure if system else None)) is not None:
                job = jobs[i]
                if system is None or system.structure != job.conditions.structure:
                    if system:
                        system.close()
                    system = System(mesh, material, job.conditions, share)
                system.reset()  # else results would depend on the number of threads
                start = rest_state(job.conditions, len(mesh.nodes))
                report = (lambda at, i=i: on_step(i, at)) if on_step else None
                goal, fractions, stop = job.conditions, job.fractions, is_cancelled.is_set
                stepping = Stepping(budget=job.budget)
                equilibria = follow(system, start, goal, fractions, report, stop, stepping)
                equilibria = confirm_equilibria(
                    system, start, goal, equilibria, fractions, stop, stepping
                )
                results[i] = continue_from_free(mesh, material, equilibria, share, stop, stepping)
                if on_solved is not None and not is_cancelled.is_set():
                    on_solved(i, results[i])
        except BaseException:
            is_cancelled.set()
            raise
        finally:
            if system:
                system.close()

    with ThreadPoolExecutor(workers, thread_name_prefix="pose") as pool:
        futures = [pool.submit(work) for _ in range(workers)]
        try:
            for future in futures:
                future.result()
        except BaseException:
            is_cancelled.set()
            raise
    return results
