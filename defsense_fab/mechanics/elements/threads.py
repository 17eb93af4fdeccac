"""Compiled loops over the elements, shared out to threads (the kernels release the interpreter)."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

SMALLEST_CHUNK = 100  # elements; below, starting a thread costs more than it saves


def count_cores() -> int:
    """Processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=4 * count_cores(), thread_name_prefix="elements")


def run_in_chunks(
    kernel: Callable[[int, int], None], count: int, threads: int, smallest: int = SMALLEST_CHUNK
) -> None:
    """Call kernel(start, stop) so that every item in 0 .. count is in one call."""
    chunks = max(1, min(threads, count // smallest))
    if chunks == 1:
        kernel(0, count)
        return
    ends = [count * i // chunks for i in range(chunks + 1)]
    waiting = [_pool().submit(kernel, ends[i], ends[i + 1]) for i in range(1, chunks)]
    kernel(0, ends[1])
    for one in waiting:
        one.result()
