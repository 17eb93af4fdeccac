"""Work on a cluster, through a scheduler of Dask: batches of runs, and poses of a device."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, TypeVar

from ....core.errors import StudyError
from ....core.machine.optional_libraries import optional
from ....mechanics.elements.material import Material
from ....mechanics.elements.tet10 import QuadraticMesh
from ....mechanics.solver.batch import Job
from ....mechanics.solver.load_stepping import Equilibrium
from .batch import Batch, ReportRecord
from .run_log import RunRecord, decode_record
from .worker import (
    encode_batch,
    find_difference,
    installed_versions,
    pack_job,
    sendable_functions,
    unpack_equilibria,
)

SCHEDULER_TIMEOUT_S = 5.0  # until a scheduler answers
FIRST_WORKER_TIMEOUT_S = 30.0
NO_WORKER_TIMEOUT_S = 120.0  # without any worker, during the work
POLL_S = 0.2
BATCHES_PER_THREAD = 2  # sent to the workers: one in progress, one waiting
LARGE_GRAPH_WARNING = "distributed.admin.large-graph-warning-threshold"
_SAME_VERSIONS = "Install the same versions there, or stop that worker"

Item = TypeVar("Item")


@contextmanager
def connect(address: str) -> Iterator[Any]:
    """Connect to the scheduler of a cluster whose workers have this machine's software.

    Args:
        address: Address of the scheduler.

    Yields:
        A client of the scheduler.

    Raises:
        StudyError: There is no scheduler (`scheduler-unreachable`) or no worker (`no-worker`), or a
            worker has other versions (`worker-versions-differ`).
    """
    with optional(StudyError, "--scheduler", "cluster", otherwise="and so on each worker"):
        import distributed
    for name in ("distributed", "distributed.client", "distributed.core"):  # errors are raised here
        logging.getLogger(name).setLevel(logging.CRITICAL)

    def make_client() -> Any:
        # A client that could not be made prints a traceback when it is deleted.
        distributed.comm.resolve_address(address)
        return distributed.Client(address, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)

    end = time.monotonic() + 2 * SCHEDULER_TIMEOUT_S
    try:
        client = _call_in_thread(make_client, lambda: time.monotonic() > end)
    except Exception as error:
        raise StudyError(
            f"no scheduler answers there ({_first_line(error)})",
            code="scheduler-unreachable",
            where=f"scheduler {address}",
            action="Start one with `dask scheduler`, whose first lines show its address",
            address=address,
        ) from None
    try:
        _check_workers(client, address)
        yield client
    finally:
        client.close(timeout=SCHEDULER_TIMEOUT_S)


def count_threads(client: Any) -> int:
    """Return the number of threads of all workers, which is the number of batches at a time."""
    return max(1, sum(_list_workers(client).values()))


@dataclass(frozen=True)
class Work(Generic[Item]):
    """Work on items.

    Attributes:
        what: Name of the work (see `worker.work_off`).
        arguments: Returns the arguments that are sent for an item.
        done: Called with an item and its result.
        lost: Called with an item that took several workers with it, and their number; returns the
            items that are tried instead.
    """

    what: str
    arguments: Callable[[Item], tuple[Any, ...]]
    done: Callable[[Item, Any], None]
    lost: Callable[[Item, int], list[Item]]


def work_on_cluster(
    client: Any, items: Sequence[Item], work: Work[Item], note: Callable[[str], None]
) -> None:
    """Do the work of all items.

    Args:
        client: Client of the scheduler.
        items: The items.
        work: The work.
        note: Called with a message when a worker disappears; its items go to others.

    Raises:
        StudyError: The scheduler disappears (`scheduler-lost`), no worker is left (`no-worker`), a
            worker fails (`worker-failed`) or has other versions (`worker-versions-differ`).
    """
    _Cluster(client, work, note).work_off(list(items))


def run_on_cluster(
    client: Any,
    batches: Sequence[Batch],
    files: bytes,
    report: ReportRecord,
    note: Callable[[str], None],
) -> None:
    """Make batches of runs on a cluster.

    If a batch took several workers with it, its runs are tried one by one; runs that do so again
    are broken.

    Args:
        client: Client of the scheduler.
        batches: The batches.
        files: The device's files.
        report: Called with the records of each finished batch.
        note: Called with messages.

    Raises:
        StudyError: As for `work_on_cluster`.
    """

    def done(_: Batch, records: Sequence[str]) -> None:
        for line in records:
            report(decode_record(line))

    def lost(batch: Batch, workers: int) -> list[Batch]:
        if len(batch.runs) > 1:
            note("a batch took several workers with it; its runs are tried one by one")
            return [replace(batch, runs=(run,)) for run in batch.runs]
        run, values = batch.runs[0]
        reason = f"{workers} workers died on it, perhaps for lack of memory"
        report(RunRecord(run, values, "broken", reason))
        return []

    work = Work("batch", lambda batch: (encode_batch(batch), files), done, lost)
    work_on_cluster(client, batches, work, note)


def solve_on_cluster(
    address: str,
    note: Callable[[str], None],
    mesh: QuadraticMesh,
    material: Material,
    jobs: Sequence[Job],
    on_step: Callable[[int, float], None] | None = None,
) -> list[list[Equilibrium]]:
    """Solve the poses of a device on a cluster, as `solve_all` does on this machine.

    Args:
        address: Address of the scheduler.
        note: Called with a message when a worker disappears.
        mesh: The mesh.
        material: The material.
        jobs: The jobs, each solved by one worker.
        on_step: Called with the index and the progress of a job.

    Returns:
        The equilibria of each job.

    Raises:
        StudyError: The cluster cannot be used, or a job took several workers with it
            (`workers-died`).
    """
    results: list[list[Equilibrium]] = [[] for _ in jobs]

    def done(i: int, data: bytes) -> None:
        results[i] = unpack_equilibria(data)
        if on_step is not None:
            on_step(i, 1.0)

    def lost(i: int, workers: int) -> list[int]:
        raise StudyError(
            f"{workers} workers died on {jobs[i].name}, perhaps for lack of memory",
            code="workers-died",
            action="Use a larger [mesh] edge_length, or workers with more memory",
            workers=workers,
        )

    work = Work("pose", lambda i: (pack_job(mesh, material, jobs[i]),), done, lost)
    with connect(address) as client:
        work_on_cluster(client, range(len(jobs)), work, note)
    return results


def cluster_solver(
    address: str, note: Callable[[str], None]
) -> Callable[..., list[list[Equilibrium]]]:
    """Return `solve_on_cluster` as a build uses it."""
    return partial(solve_on_cluster, address, note)


class _Cluster(Generic[Item]):
    """Sends items to the workers and collects their results."""

    def __init__(self, client: Any, work: Work[Item], note: Callable[[str], None]) -> None:
        self._client, self._work, self._note = client, work, note
        self._function, self._versions = sendable_functions()[0], installed_versions()
        self._workers = set(_list_workers(client))
        self._last_worker_at = time.monotonic()

    def work_off(self, waiting: list[Item]) -> None:
        import dask

        pending: dict[Any, Item] = {}
        # A mesh is sent with each of its poses, of which Dask would warn.
        with dask.config.set({LARGE_GRAPH_WARNING: "1 TB"}):
            try:
                while waiting or pending:
                    limit = BATCHES_PER_THREAD * max(1, count_threads(self._client))
                    while waiting and len(pending) < limit:
                        item = waiting.pop(0)
                        pending[self._submit(item)] = item
                    done = [f for f in pending if f.done()]
                    if not done:
                        time.sleep(POLL_S)
                    self._check_connection()
                    for future in done:
                        waiting += self._collect(future, pending.pop(future))
            finally:
                if pending and self._client.status == "running":
                    self._client.cancel(list(pending))

    def _submit(self, item: Item) -> Any:
        arguments = self._work.arguments(item)
        return self._client.submit(
            self._function, self._work.what, self._versions, *arguments, pure=False
        )

    def _collect(self, future: Any, item: Item) -> list[Item]:
        """Process the result of an item; return the items that are tried again."""
        import distributed

        try:  # results may be large
            result = _call_in_thread(future.result, lambda: self._client.status != "running")
        except distributed.KilledWorker as error:
            return self._work.lost(item, error.allowed_failures + 1)
        except (OSError, CancelledError, TimeoutError):
            raise _scheduler_lost() from None
        except Exception as error:
            raise StudyError(
                f"a worker failed with {type(error).__name__}: {_first_line(error)}",
                code="worker-failed",
                action="See its log",
            ) from None
        if "refused" in result:
            raise StudyError(
                f"a worker {result['refused']}",
                code="worker-versions-differ",
                action=_SAME_VERSIONS,
            )
        if "failed" in result:
            raise StudyError(f"a worker cannot work: {result['failed']}", code="worker-failed")
        self._work.done(item, result["result"])
        return []

    def _check_connection(self) -> None:
        try:
            workers = set(_list_workers(self._client))
        except OSError:
            raise _scheduler_lost() from None
        if self._client.status != "running":
            raise _scheduler_lost()
        for address in sorted(self._workers - workers):
            self._note(f"the worker {address} has disappeared; its work goes to another")
        self._workers = workers
        if workers:
            self._last_worker_at = time.monotonic()
        elif time.monotonic() - self._last_worker_at > NO_WORKER_TIMEOUT_S:
            raise StudyError(
                f"there was no worker for {NO_WORKER_TIMEOUT_S:.0f} s; finished work is kept",
                code="no-worker",
                action="Start workers, and run the same command to resume",
            )


def _scheduler_lost() -> StudyError:
    return StudyError(
        "the scheduler has disappeared; finished work is kept",
        code="scheduler-lost",
        action="Run the same command to resume",
    )


def _call_in_thread(function: Callable[[], Any], should_give_up: Callable[[], bool]) -> Any:
    """Return the result of a function that runs in its own thread, or raise its error.

    TimeoutError is raised once `should_give_up` is true; the thread is then left alone.
    """
    result: Future[Any] = Future()

    def run() -> None:
        try:
            result.set_result(function())
        except BaseException as error:  # any error is raised in the waiting thread
            result.set_exception(error)

    threading.Thread(target=run, daemon=True, name="cluster").start()
    while not result.done():
        wait([result], POLL_S)
        if should_give_up() and not result.done():
            raise TimeoutError("no answer in time")
    return result.result()


def _list_workers(client: Any) -> dict[str, int]:
    """Return the threads of the workers by address."""
    return {address: int(threads) for address, threads in client.nthreads().items()}


def _check_workers(client: Any, address: str) -> None:
    where = f"scheduler {address}"
    try:
        client.wait_for_workers(1, timeout=FIRST_WORKER_TIMEOUT_S)
    except TimeoutError:
        raise StudyError(
            f"no worker has connected to it within {FIRST_WORKER_TIMEOUT_S:.0f} s",
            code="no-worker",
            where=where,
            action=f"Start some with `dask worker {address} --nthreads 1`",
        ) from None
    try:
        expected, actual = installed_versions(), client.run(sendable_functions()[1])
    except Exception as error:
        raise StudyError(
            f"its workers cannot report their versions ({type(error).__name__}:"
            f" {_first_line(error)})",
            code="worker-versions-differ",
            where=where,
            action=_SAME_VERSIONS,
        ) from None
    for worker, versions in sorted(actual.items()):
        if difference := find_difference(expected, versions):
            raise StudyError(
                f"has {difference}",
                code="worker-versions-differ",
                where=f"worker {worker}",
                action=_SAME_VERSIONS,
                worker=worker,
            )


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0][:120] if str(error) else type(error).__name__
