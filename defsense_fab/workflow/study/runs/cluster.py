"""Work on a cluster, through a scheduler of Dask: batches of runs, and whatever else is `Work`."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from ....core.errors import StudyError
from ....core.machine.optional_libraries import optional
from .batch import Batch, Tell
from .run_log import RunRecord, decoded
from .versions import difference, installed
from .worker import as_text, travelling

#: s: until a scheduler answers, until a first worker comes, without any worker on the way.
ANSWERS, COMES, WITHOUT = 5.0, 30.0, 120.0
_LOOK = 0.2
_GONE = "the scheduler has gone; what was done until then is kept, and the same command goes on"
_AHEAD = 2  # batches sent for each worker's thread: one is worked on, one is there already
_INSTALL = "install the same versions there, or take that worker away"

Item = TypeVar("Item")


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of the scheduler at an `address`, whose workers have this machine's software. Raises
    StudyError where there is no scheduler, no worker, or another version."""
    with optional(StudyError, "--scheduler", "cluster", otherwise="and so on each worker"):
        import distributed
    for name in ("distributed", "distributed.client", "distributed.core"):  # it is told here
        logging.getLogger(name).setLevel(logging.CRITICAL)

    def client_there() -> Any:
        # A client that could not be made prints a traceback where it is thrown away.
        distributed.comm.resolve_address(address)
        return distributed.Client(address, timeout=ANSWERS, set_as_default=False)

    end = time.monotonic() + 2 * ANSWERS
    try:
        client = _waited(client_there, lambda: time.monotonic() > end)
    except Exception as error:
        raise StudyError(
            f"--scheduler {address}: no scheduler answers there ({_first_line(error)}); start one"
            " with `dask scheduler`, whose first lines tell its address"
        ) from None
    try:
        _check_workers(client, address)
        yield client
    finally:
        client.close(timeout=ANSWERS)


def threads_there(client: Any) -> int:
    """Of all workers: so many batches are worked on at a time."""
    return max(1, sum(_workers(client).values()))


@dataclass(frozen=True)
class Work(Generic[Item]):
    """What is to be done with items on a cluster: `what` names it to the workers, `arguments` are
    sent for an item, `done` is told its result, and `lost` what took so many workers with it, which
    returns what is to be tried in its place."""

    what: str
    arguments: Callable[[Item], tuple[Any, ...]]
    done: Callable[[Item, Any], None]
    lost: Callable[[Item, int], list[Item]]


def work_on_cluster(
    client: Any, items: Sequence[Item], work: Work[Item], note: Callable[[str], None]
) -> None:
    """Do the work of all items. `note` is told of workers that go: what they were at goes to
    others.

    Raises StudyError where the scheduler goes, no worker is left, one fails or has another version.
    """
    _Cluster(client, work, note).work_off(list(items))


def run_on_cluster(
    client: Any,
    batches: Sequence[Batch],
    files: bytes,
    tell: Tell,
    note: Callable[[str], None],
) -> None:
    """Make all batches; the records of each are told when it is done. Where a batch has taken
    several workers with it, its runs are tried one by one, and those that do so again are broken.

    Raises StudyError as `work_on_cluster` does.
    """

    def done(_: Batch, records: Sequence[str]) -> None:
        for line in records:
            tell(decoded(line))

    def lost(batch: Batch, workers: int) -> list[Batch]:
        if len(batch.runs) > 1:
            note("a batch took several workers with it; its runs are tried one by one")
            return [replace(batch, runs=(run,)) for run in batch.runs]
        run, values = batch.runs[0]
        why = f"{workers} workers died on it, perhaps for want of memory"
        tell(RunRecord(run, values, "broken", why))
        return []

    work = Work("batch", lambda batch: (as_text(batch), files), done, lost)
    work_on_cluster(client, batches, work, note)


class _Cluster(Generic[Item]):
    def __init__(self, client: Any, work: Work[Item], note: Callable[[str], None]) -> None:
        self._client, self._work, self._note = client, work, note
        self._function, self._wanted = travelling()[0], installed()
        self._there = set(_workers(client))
        self._since = time.monotonic()  # when workers were last there

    def work_off(self, waiting: list[Item]) -> None:
        import dask

        pending: dict[Any, Item] = {}
        # A mesh is sent with each of its poses; Dask would warn of that.
        with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 TB"}):
            try:
                while waiting or pending:
                    while waiting and len(pending) < _AHEAD * max(1, threads_there(self._client)):
                        item = waiting.pop(0)
                        pending[self._submit(item)] = item
                    done = [f for f in pending if f.done()]
                    if not done:
                        time.sleep(_LOOK)
                    self._watch()
                    for future in done:
                        waiting += self._ended(future, pending.pop(future))
            finally:
                if pending and self._client.status == "running":
                    self._client.cancel(list(pending))

    def _submit(self, item: Item) -> Any:
        sent = self._work.arguments(item)
        return self._client.submit(self._function, self._work.what, self._wanted, *sent, pure=False)

    def _ended(self, future: Any, item: Item) -> list[Item]:
        """What is to be tried again."""
        import distributed

        try:  # what comes back may be large
            result = _waited(future.result, lambda: self._client.status != "running")
        except distributed.KilledWorker as error:
            return self._work.lost(item, error.allowed_failures + 1)
        except (OSError, CancelledError, TimeoutError):
            raise StudyError(_GONE) from None
        except Exception as error:
            raise StudyError(
                f"a worker failed with {type(error).__name__}: {_first_line(error)}; see its log"
            ) from None
        if "refused" in result:
            raise StudyError(f"a worker {result['refused']}; {_INSTALL}")
        if "failed" in result:
            raise StudyError(f"a worker cannot work: {result['failed']}")
        self._work.done(item, result["result"])
        return []

    def _watch(self) -> None:
        try:
            there = set(_workers(self._client))
        except OSError:
            raise StudyError(_GONE) from None
        if self._client.status != "running":
            raise StudyError(_GONE)
        for address in sorted(self._there - there):
            self._note(f"the worker {address} has gone; its work goes to another")
        self._there = there
        if there:
            self._since = time.monotonic()
        elif time.monotonic() - self._since > WITHOUT:
            raise StudyError(
                f"no worker has been there for {WITHOUT:.0f} s; what was done until then is kept:"
                " start workers, and the same command goes on"
            )


def _waited(work: Callable[[], Any], given_up: Callable[[], bool]) -> Any:
    """What `work` returns or raises in a thread of its own, which is left alone once it is given
    up: TimeoutError is raised then."""
    found: Future[Any] = Future()

    def run() -> None:
        try:
            found.set_result(work())
        except BaseException as error:  # whatever it is, who waits is told
            found.set_exception(error)

    threading.Thread(target=run, daemon=True, name="cluster").start()
    while not found.done():
        wait([found], _LOOK)
        if given_up() and not found.done():
            raise TimeoutError("no answer in time")
    return found.result()


def _workers(client: Any) -> dict[str, int]:
    """Addresses of the workers, and their threads."""
    return {address: int(threads) for address, threads in client.nthreads().items()}


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=COMES)
    except TimeoutError:
        raise StudyError(
            f"--scheduler {address}: no worker has come to it within {COMES:.0f} s; start some with"
            f" `dask worker {address} --nthreads 1`"
        ) from None
    try:
        wanted, there = installed(), client.run(travelling()[1])
    except Exception as error:
        raise StudyError(
            f"--scheduler {address}: its workers cannot tell their versions"
            f" ({type(error).__name__}: {_first_line(error)}); {_INSTALL}"
        ) from None
    for worker, versions in sorted(there.items()):
        if other := difference(wanted, versions):
            raise StudyError(f"the worker {worker} has {other}; {_INSTALL}")


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0][:120] if str(error) else type(error).__name__
