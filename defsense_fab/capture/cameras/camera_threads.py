"""Cameras side by side, each in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import cv2

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@contextmanager
def one_thread_per_call(wanted: bool = True) -> Iterator[None]:
    """OpenCV does not share a call's work out among threads of its own meanwhile: callers that are
    threads already would wait for each other, twice as long as the work takes."""
    threads = cv2.getNumThreads()
    if wanted:
        cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def in_threads(
    work: Callable[[_Item, threading.Event], _Result], items: Sequence[_Item], at_most: int
) -> list[_Result]:
    """`work` on all items, `at_most` at once. It is also given an event, which is set when the
    others need not finish: after an error in one, which is raised here, or an interruption."""
    stop = threading.Event()
    with one_thread_per_call(), ThreadPoolExecutor(min(len(items), at_most)) as pool:
        jobs = [pool.submit(work, item, stop) for item in items]
        try:
            return [job.result() for job in jobs]
        except BaseException:
            stop.set()
            raise
