"""The orders of a body's cuts that are compared, for its parts and for the optimiser's slivers."""

from __future__ import annotations

import itertools

#: All orders of the cuts are tried for up to this many planes.
_ALL = 4


def cut_orders(planes: int) -> list[tuple[int, ...]]:
    """Orders in which so many planes (by index) may be cut: all of them for few planes, whose
    parts depend on it; that of the sensors for more."""
    order = tuple(range(planes))
    return list(itertools.permutations(order)) if planes <= _ALL else [order]
