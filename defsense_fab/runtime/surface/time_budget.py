"""How long a frame may take."""

from __future__ import annotations

import time


class TimeBudget:
    """Of `seconds` from now on, None for as long as it takes: `allows` one more round while one as
    long as the longest so far still ends in time. The first round is always allowed."""

    def __init__(self, seconds: float | None) -> None:
        self._last = time.perf_counter()
        self._end = None if seconds is None else self._last + seconds
        self._longest = 0.0
        self._rounds = 0

    def allows(self) -> bool:
        """To be asked before each round."""
        now = time.perf_counter()
        if self._rounds:
            self._longest = max(self._longest, now - self._last)
        self._last = now
        self._rounds += 1
        if self._end is None or self._rounds == 1:
            return True
        return now + self._longest <= self._end
