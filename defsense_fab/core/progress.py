"""The one callback through which long work reports."""

from __future__ import annotations

from collections.abc import Callable

#: Called with the stage's name, the fraction done (0 to 1) and a short message.
Progress = Callable[[str, float, str], None]


def silent(stage: str, fraction: float, message: str) -> None:
    """Report to nobody."""
