"""Many solves over the cores: one thread a structure of boundary conditions, a factor for each."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from ..elements.material import Material
from ..elements.tet10 import QuadraticMesh
from ..elements.threads import count_cores
from ..loading.boundary_conditions import BoundaryConditions, rest_state
from .load_stepping import Equilibrium, confirm_equilibria, follow, continue_from_free
from .newton import System


@dataclass(frozen=True)
class Job:
    """Equilibria at increasing `fractions` of the way from rest to `conditions`; its `name` is for
    people."""

    conditions: BoundaryConditions
    fractions: tuple[float, ...]
    name: str = ""


def solve_all(
    mesh: QuadraticMesh,
    material: Material,
    jobs: Sequence[Job],
    on_step: Callable[[int, float], None] | None = None,
    threads: int | None = None,
) -> list[list[Equilibrium]]:
    """What `load_stepping.follow`, `confirmed` and `move_on` give for each job, in their order,
    however many threads there are.

    `on_step(job, fraction)` is called from the threads. When the caller is interrupted or one job
    raises, the others are cancelled before the exception goes on.
    """
    total = threads or count_cores()
    workers = max(1, min(total, len(jobs)))
    waiting = sorted(range(len(jobs)), key=lambda i: jobs[i].conditions.structure.__repr__())
    lock, ended = threading.Lock(), threading.Event()
    results: list[list[Equilibrium]] = [[] for _ in jobs]

    def take(structure: object) -> int | None:
        """The next job, if possible one that the thread's factorisation fits."""
        with lock:
            if not waiting or ended.is_set():
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
                    system = System(mesh, material, job.conditions, max(1, total // workers))
                system.reset()  # or fields would hang by the number of threads
                start = rest_state(job.conditions, len(mesh.nodes))
                tell = (lambda at, i=i: on_step(i, at)) if on_step else None
                found = follow(system, start, job.conditions, job.fractions, tell, ended.is_set)
                found = confirm_equilibria(
                    system, start, job.conditions, found, job.fractions, ended.is_set
                )
                share = max(1, total // workers)
                results[i] = continue_from_free(mesh, material, found, share, ended.is_set)
        except BaseException:
            ended.set()
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
            ended.set()
            raise
    return results
