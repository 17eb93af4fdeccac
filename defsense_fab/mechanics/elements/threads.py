"""Split loops over elements or points into chunks that threads run.

The compiled kernels release the interpreter, so threads run them at the same time.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

MIN_CHUNK_ELEMENTS = 100  # below, starting a thread costs more than it saves


def count_cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=4 * count_cores(), thread_name_prefix="elements")


def run_in_chunks(
    kernel: Callable[[int, int], None],
    count: int,
    threads: int,
    smallest: int = MIN_CHUNK_ELEMENTS,
) -> None:
    """Call a kernel on consecutive ranges that together cover all items.

    Args:
        kernel: Function of `(start, stop)`; it must not depend on the other ranges.
        count: Number of items.
        threads: Largest number of ranges, each in its own thread.
        smallest: Smallest number of items worth a thread.
    """
    chunks = max(1, min(threads, count // smallest))
    if chunks == 1:
        kernel(0, count)
        return
    ends = [count * i // chunks for i in range(chunks + 1)]
    futures = [_pool().submit(kernel, ends[i], ends[i + 1]) for i in range(1, chunks)]
    kernel(0, ends[1])
    for future in futures:
        future.result()
