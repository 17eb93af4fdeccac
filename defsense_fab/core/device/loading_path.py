"""How far along which path of loading a state lies."""

from __future__ import annotations

from collections.abc import Mapping

#: The poses of a path by name, and how much of each there is where the largest is whole.
LoadingPath = tuple[tuple[str, float], ...]


def on_path(weights: Mapping[str, float]) -> tuple[LoadingPath, float]:
    """Of a state with so much of each pose (of one at least, not zero): poses of which it has
    nothing, and the order in which they are given, do not matter."""
    largest = max(map(abs, weights.values()))
    return tuple((n, round(w / largest, 9)) for n, w in sorted(weights.items()) if w), largest
