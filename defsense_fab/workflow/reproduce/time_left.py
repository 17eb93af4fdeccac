"""How long many steps still take, reckoned from those that were done."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from ...core.progress import Progress

#: s of a step that found everything made: it says nothing of the others.
_NOTHING = 1.0


class TimeLeft:
    """Reports the steps by their number and name, with the time that those of the same kind took:
    the kind is what a name ends with ("unit 1", "pictures") without its number."""

    def __init__(self, steps: Sequence[str], progress: Progress) -> None:
        self._left, self._count = list(steps), max(len(steps), 1)
        self._show, self._stage = progress, ""
        self._taken: dict[str, list[float]] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[Progress]:
        """One of the steps: gives what it reports to."""
        self._stage, begun = name, time.monotonic()
        self._show(name, 0.0, self._words("begun"))
        yield self.progress
        if name in self._left:
            self._left.remove(name)
        took = time.monotonic() - begun
        if took > _NOTHING:
            self._taken.setdefault(_kind(name), []).append(took)
        self._show(name, 1.0, "done")

    def progress(self, stage: str, fraction: float, message: str) -> None:
        """Part of the step at hand."""
        self._show(self._stage, min(fraction, 0.999), self._words(f"{stage}: {message}"))

    def remaining(self) -> float | None:
        """s of the steps that are left, the one at hand included; None before any was done."""
        every = [t for some in self._taken.values() for t in some]
        if not every:
            return None
        usual = sum(every) / len(every)
        own = {kind: sum(some) / len(some) for kind, some in self._taken.items()}
        return sum(own.get(_kind(name), usual) for name in self._left)

    def _words(self, message: str) -> str:
        done = self._count - len(self._left)
        left = self.remaining()
        about = "" if left is None else f", about {max(round(left / 60), 1)} min left"
        return f"{done + 1} of {self._count}{about}: {message}"


def _kind(name: str) -> str:
    return name.rpartition(": ")[2].rpartition(", ")[2].rstrip("0123456789 ")
