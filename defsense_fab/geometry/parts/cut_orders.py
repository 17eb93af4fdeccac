"""The orders of a body's cuts that are compared, for its parts and for the optimiser's slivers."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

#: All orders of the cuts are tried for up to this many planes.
_ALL = 4


def cut_orders(planes: int, early: Sequence[int] = ()) -> list[tuple[int, ...]]:
    """Orders in which so many planes (by index) may be cut: all of them for few planes, whose
    parts depend on it; for more that of the sensors, and that with the `early` ones first."""
    order = tuple(range(planes))
    if planes <= _ALL:
        return list(itertools.permutations(order))
    rest = tuple(i for i in order if i not in early)
    return list(dict.fromkeys([order, (*early, *rest)]))
