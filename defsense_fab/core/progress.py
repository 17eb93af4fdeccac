"""Reports of long work: its progress, and notices that the user should attend to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

#: Called with the stage's name, the fraction done (0 to 1) and a short message.
Progress = Callable[[str, float, str], None]
#: Called within a stage with the fraction done (0 to 1) and a short message.
Report = Callable[[float, str], None]


def silent(stage: str, fraction: float, message: str) -> None:
    """Report to nobody."""


def subrange(report: Report, low: float, high: float) -> Report:
    """Return a report for the part of a stage between two fractions of it.

    Args:
        report: Report of the stage.
        low: Fraction of the stage at which the part starts.
        high: Fraction at which it ends.
    """
    return lambda fraction, message: report(low + (high - low) * fraction, message)


def describe_duration(seconds: float) -> str:
    """Return a duration for people, as in "40 s", "12 min", "2.3 h" and "18 h"."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes, hours = seconds / 60, seconds / 3600
    if minutes < 59.5:
        return f"{minutes:.0f} min"
    return f"{hours:.{0 if hours >= 9.95 else 1}f}".removesuffix(".0") + " h"


@dataclass(frozen=True)
class Notice:
    """A doubt about data or a device.

    Attributes:
        code: Stable identifier of the kind of doubt.
        text: The doubt for people, with what to do about it.
        where: What the doubt is about, such as the name of a cord; empty if the code says it.
        data: Facts for programs.
    """

    code: str
    text: str
    where: str = ""
    data: Mapping[str, object] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.text
