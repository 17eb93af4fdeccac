"""Which of several layouts is taken: the most accurate, or the simplest of those as accurate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

#: Layouts within this of the best are as good: the band of built devices is wider.
ALIKE = 1.05


class Weighed(Protocol):
    """What is known of a layout that was made on trial; see `WeighedRecord`."""

    @property
    def built(self) -> float | None: ...
    @property
    def parts(self) -> int | None: ...
    @property
    def free_ends(self) -> int: ...
    @property
    def slanted(self) -> int: ...
    @property
    def warnings(self) -> tuple[str, ...]: ...
    @property
    def problem(self) -> str | None: ...


W = TypeVar("W", bound=Weighed)


def effort(one: Weighed) -> tuple[bool, int, int, int]:
    """Less is simpler: whether anything is to be said, parts and ends without pockets, directions
    of planes that are no face's, how much is to be said."""
    pieces = (one.parts or 0) + one.free_ends
    return bool(one.warnings), pieces, one.slanted, len(one.warnings)


def preferred(trials: Sequence[W], prefer: str) -> W | None:
    """Of those that can be made: with `[design] prefer = "accuracy"` the best as built, else the
    simplest of those as good as the best. None where none can be made."""
    made = [t for t in trials if t.problem is None]
    if not made:
        return None
    if prefer == "accuracy":
        return min(made, key=_built)
    best = min(_built(t) for t in made)
    alike = [t for t in made if _built(t) <= ALIKE * best]
    return min(alike, key=lambda t: (*effort(t), _built(t)))


def _built(one: Weighed) -> float:
    return float("inf") if one.built is None else one.built
