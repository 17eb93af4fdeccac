"""Count what reading the variants of a test returns, and print the counts for `pytest -s`."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable

import pytest

from defsense_fab.core.machine.processes import peak_memory_mb


class Tally:
    """Counts of outcomes, with the time of the slowest.

    Attributes:
        counts: Number of variants by outcome. A failed assertion is a `silent error`, any other
            exception a `traceback`.
        slowest: Longest time of a variant, s.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter({"silent error": 0, "traceback": 0})
        self.slowest = 0.0

    def add(self, read: Callable[[], str]) -> str:
        """Call a function, count its outcome, and return it.

        Args:
            read: Reads a variant, checks what it returns, and returns the outcome in words.
        """
        started_at, outcome = time.perf_counter(), "traceback"
        try:
            outcome = read()
        except (AssertionError, pytest.fail.Exception):
            outcome = "silent error"
            raise
        finally:
            self.counts[outcome] += 1
            self.slowest = max(self.slowest, time.perf_counter() - started_at)
        return outcome

    def show(self, title: str) -> None:
        """Print the counts, the longest time and the peak memory of the process, if any."""
        if not self.counts.total():
            return
        print(
            f"\n{title}: {dict(self.counts)}, at most {self.slowest:.2f} s"
            f" and {peak_memory_mb():.0f} MB"
        )
