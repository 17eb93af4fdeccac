"""What one check has found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Status = Literal["good", "missing", "not needed"]


@dataclass(frozen=True)
class Finding:
    """`about` what, and `told` in words. What is missing may have a `command` that mends it; what
    is not needed says for what it would be (`needed_for`). `core`: needed by all."""

    check: str
    about: str
    status: Status
    told: str
    command: str = ""
    needed_for: str = ""
    core: bool = False

    def __post_init__(self) -> None:
        if self.status == "not needed" and not self.needed_for:
            raise ValueError(f"{self.about}: what is not needed says for what it would be")
        if self.status == "not needed" and self.core:
            raise ValueError(f"{self.about}: what the core needs is good or missing")


def judged(
    check: str,
    about: str,
    good: bool,
    told: str,
    *,
    command: str = "",
    needed_for: str = "",
) -> Finding:
    """Good, or not needed but `needed_for` something; the core's, or missing, without that."""
    core = not needed_for
    if good:
        return Finding(check, about, "good", told, core=core)
    status: Status = "missing" if core else "not needed"
    return Finding(check, about, status, told, command, needed_for, core)
