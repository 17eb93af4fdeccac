"""Batches in processes of this machine."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait

from ....mechanics.elements.threads import count_cores
from .batch import Batch, Tell, run_batch
from .run_log import RunRecord


def run_here(batches: Sequence[Batch], files: bytes, workers: int, tell: Tell) -> None:
    """Make all batches, so many at a time; each record is told, one at a time, as it is there. When
    this is interrupted, or one cannot go on, the processes of all end within seconds."""
    stop, lock = threading.Event(), threading.Lock()

    def told(record: RunRecord) -> None:
        with lock:
            tell(record)

    with ThreadPoolExecutor(workers, thread_name_prefix="study") as pool:
        futures = [pool.submit(run_batch, b, files, told, stop.is_set) for b in batches]
        try:
            done, _ = wait(futures, return_when=FIRST_EXCEPTION)
            for future in done:
                future.result()
        finally:
            stop.set()
            for future in futures:
                future.cancel()


def threads_each(workers: int) -> int:
    """Threads of a run, so that all together are as many as the machine has cores."""
    return max(1, count_cores() // workers)
