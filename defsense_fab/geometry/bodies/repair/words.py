"""How places and counts are told."""

from __future__ import annotations

from ....core.arrays import Float


def place(p: Float) -> str:
    """A point (3,) mm."""
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in p) + ")"


def number(count: int, one: str, many: str = "") -> str:
    """As in 1 hole, 2 holes."""
    return f"{count} {one if count == 1 else many or one + 's'}"
