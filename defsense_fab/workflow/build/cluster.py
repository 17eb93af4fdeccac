"""Work on a Dask cluster: groups of runs of a study; poses and searches of a build.

Everything that Dask sends is pickled: the scheduler and its workers are trusted.
"""

from __future__ import annotations

import logging
import platform
import sys
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, wait
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...core.errors import DefsenseError, StudyError
from ...core.machine.optional_libraries import optional
from ...core.mesh import TetMesh
from ...core.version import __version__
from ...mechanics.elements.material import Material
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.solver.batch import Job, solve_all
from ...mechanics.solver.load_stepping import Equilibrium
from . import stages

SCHEDULER_TIMEOUT_S = 5.0  # until a scheduler answers
FIRST_WORKER_TIMEOUT_S = 30.0
CHECK_INTERVAL_S = 5.0
MAX_CHECKS_WITHOUT_WORKERS = 24  # 2 minutes


@contextmanager
def connect(address: str) -> Iterator[Any]:
    """Connect to the scheduler of a cluster.

    Args:
        address: Address of the scheduler.

    Yields:
        A client of the scheduler.

    Raises:
        StudyError: There is no scheduler (`scheduler-unreachable`) or no worker (`no-worker`).
    """
    with optional(StudyError, "scheduler", "cluster", otherwise="and so on each worker"):
        import distributed
    for name in ("distributed", "distributed.client", "distributed.core"):  # errors are raised here
        logging.getLogger(name).setLevel(logging.CRITICAL)
    where = f"scheduler {address}"
    try:
        # A client that could not be made prints a traceback when it is deleted.
        distributed.comm.resolve_address(address)
        client = distributed.Client(address, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)
    except Exception as error:
        raise StudyError(
            f"no scheduler answers there ({_first_line(error)})",
            code="scheduler-unreachable",
            where=where,
            action="Start one with `dask scheduler`, whose first lines show its address",
            address=address,
        ) from None
    try:
        try:
            client.wait_for_workers(1, timeout=FIRST_WORKER_TIMEOUT_S)
        except TimeoutError:
            raise StudyError(
                f"no worker has connected to it within {FIRST_WORKER_TIMEOUT_S:.0f} s",
                code="no-worker",
                where=where,
                action=f"Start some with `dask worker {address} --nthreads 1`",
            ) from None
        yield client
    finally:
        client.close(timeout=SCHEDULER_TIMEOUT_S)


def installed_versions() -> dict[str, str]:
    """Return the versions of all software that influences the result of a run, by name.

    They are those of the package, of its results, and of the libraries of all stages of a run
    ("none" if one is not installed). All machines of a cluster must have the same.
    """
    versions = {
        "defsense-fab": __version__,
        "results": str(stages.CODE_VERSION),
        "Python": ".".join(platform.python_version_tuple()[:2]),
    }
    for stage, libraries in stages.installed_versions().items():
        if stage != "report":
            versions |= {name: version or "none" for name, version in libraries}
    return versions


def count_threads(client: Any) -> int:
    """Return the number of threads of all workers, which is the number of tasks at a time."""
    return max(1, int(sum(client.nthreads().values())))


def map_on_cluster(
    client: Any, function: Callable[..., Any], tasks: Sequence[Any], shared: Any
) -> Generator[tuple[int, Any], None, None]:
    """Call a function for each task on the workers of a cluster.

    Args:
        client: Client of the scheduler.
        function: Function of a task and `shared`, in a module of this package.
        tasks: The tasks.
        shared: Data that are sent to each worker once.

    Yields:
        Index and result of each finished task, in the order of completion. The result of a task
        during which several workers died is a StudyError (`workers-died`).

    Raises:
        StudyError: The scheduler or all workers disappear (`scheduler-lost`, `no-worker`), or a
            worker fails (`worker-failed`) or has other versions (`worker-versions-differ`).
        DefsenseError: The function raised it.
    """
    data = client.scatter([shared], broadcast=True)[0]
    executor, versions = client.get_executor(pure=False), installed_versions()
    try:
        numbers = {
            executor.submit(_call, function, versions, task, data): i
            for i, task in enumerate(tasks)
        }
        waiting, checks_without_workers = set(numbers), 0
        while waiting:
            done, waiting = wait(waiting, CHECK_INTERVAL_S, FIRST_COMPLETED)
            checks_without_workers = 0 if _has_workers(client) else checks_without_workers + 1
            if checks_without_workers >= MAX_CHECKS_WITHOUT_WORKERS:
                raise StudyError(
                    "all workers have disappeared; finished work is kept",
                    code="no-worker",
                    action="Start workers, and run the same command to resume",
                )
            for future in done:
                yield numbers[future], _result(future)
    finally:
        executor.shutdown(wait=False)


def _call(function: Callable[..., Any], expected: Mapping[str, str], task: Any, shared: Any) -> Any:
    """Call a function on a worker, which must have the same software."""
    versions = installed_versions()
    for name, version in expected.items():
        if versions.get(name) != version:
            raise StudyError(
                f"a worker has {name} {versions.get(name)} instead of {version}",
                code="worker-versions-differ",
                action="Install the same versions there, or stop that worker",
                name=name,
            )
    return function(task, shared)


def _result(future: Any) -> Any:
    import distributed

    try:
        return future.result()
    except distributed.KilledWorker as error:
        workers = error.allowed_failures + 1
        return StudyError(
            f"{workers} workers died on it, perhaps for lack of memory",
            code="workers-died",
            action="Use a larger [mesh] edge_length, or workers with more memory",
            workers=workers,
        )
    except DefsenseError:
        raise
    except (CancelledError, TimeoutError):
        raise _scheduler_lost() from None
    except Exception as error:
        raise StudyError(
            f"a worker failed with {type(error).__name__}: {_first_line(error)}",
            code="worker-failed",
            action="See its log",
        ) from None


def _has_workers(client: Any) -> bool:
    """Return whether the cluster has a worker.

    Raises:
        StudyError: The scheduler has disappeared (`scheduler-lost`).
    """
    try:
        if client.status == "running":
            return bool(client.nthreads())
    except (OSError, TimeoutError):
        pass
    raise _scheduler_lost()


def _scheduler_lost() -> StudyError:
    return StudyError(
        "the scheduler has disappeared; finished work is kept",
        code="scheduler-lost",
        action="Run the same command to resume",
    )


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0][:120] if str(error) else type(error).__name__


def cancellation_check() -> Callable[[], bool]:
    """Return a function that tells whether the present task of a worker is not needed any more.

    Dask does not stop a running task whose client has cancelled it or ended. Elsewhere than on a
    worker the function always returns False; it may be called from any thread.
    """
    distributed = sys.modules.get("distributed")  # not imported: no worker
    try:
        worker = distributed.get_worker() if distributed else None
    except ValueError:
        worker = None
    if worker is None:
        return lambda: False
    key = worker.get_current_task()

    def is_cancelled() -> bool:
        task = worker.state.tasks.get(key)
        return task is None or task.state == "cancelled"

    return is_cancelled


def stop_if_cancelled() -> Callable[..., None]:
    """Return a function of anything that raises an error once the present task is not needed."""
    is_cancelled = cancellation_check()

    def check(*_: object) -> None:
        if is_cancelled():
            raise StudyError("cancelled", code="cancelled")

    return check


def cluster_tasks(
    address: str, note: Callable[[str], None]
) -> Callable[[Callable[..., Any], Sequence[Any], Any], Generator[tuple[int, Any], None, None]]:
    """Return a function that calls a function for each task on a cluster.

    It takes and yields what `map_on_cluster` does, without the client. Each task has a `name`. One
    during which several workers died raises its StudyError.

    Args:
        address: Address of the scheduler.
        note: Called with a message.
    """

    def run(
        function: Callable[..., Any], tasks: Sequence[Any], shared: Any
    ) -> Generator[tuple[int, Any], None, None]:
        note(f"connecting to {address}")
        with connect(address) as client:
            workers = count_threads(client)
            note(f"{len(tasks)} tasks on {workers} thread{'s' if workers > 1 else ''} of workers")
            for i, result in map_on_cluster(client, function, tasks, shared):
                if isinstance(result, StudyError):
                    result.where = tasks[i].name
                    raise result
                yield i, result

    return run


def cluster_solver(
    address: str, note: Callable[[str], None]
) -> Callable[..., list[list[Equilibrium]]]:
    """Return a function that solves poses on a cluster, as `solve_all` does on this machine.

    Args:
        address: Address of the scheduler.
        note: Called with a message.
    """
    run = cluster_tasks(address, note)

    def solve(
        mesh: QuadraticMesh,
        material: Material,
        jobs: Sequence[Job],
        on_step: Callable[[int, float], None] | None = None,
        on_solved: Callable[[int, list[Equilibrium]], None] | None = None,
    ) -> list[list[Equilibrium]]:
        # The quadratic mesh is recreated from its corners, which are fewer data.
        tets = mesh.cells[:, :4]
        shared = TetMesh(mesh.nodes[: int(tets.max()) + 1], np.ascontiguousarray(tets)), material
        results: list[list[Equilibrium]] = [[] for _ in jobs]
        for i, result in run(_solve_job, jobs, shared):
            results[i] = result
            if on_solved is not None:
                on_solved(i, result)
            if on_step is not None:
                on_step(i, 1.0)
        return results

    return solve


def _solve_job(job: Job, shared: tuple[TetMesh, Material]) -> list[Equilibrium]:
    mesh, material = shared
    quadratic = QuadraticMesh.from_linear(mesh)
    # A worker has a thread for each task; other threads and workers use the other cores.
    return solve_all(quadratic, material, [job], stop_if_cancelled(), threads=1)[0]
