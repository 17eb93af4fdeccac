"""What is wrong with a dataset, how bad that is, and what to do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ...core.errors import TrainingError


@dataclass(frozen=True)
class Problem:
    """Of a `kind` (one word or two), at the recordings or channels named in `what`; `fatal` where
    it forbids training; what to do as `remedy`; the `value` that was found, if it is a number, in
    the unit that `what` says; the recordings `of` which it is."""

    kind: str
    fatal: bool
    what: str
    remedy: str
    value: float | None = None
    of: tuple[str, ...] = ()

    def __str__(self) -> str:
        if self.what.endswith("?"):
            return f"{self.what} {self.remedy[:1].upper()}{self.remedy[1:]}"
        return f"{self.what}; {self.remedy}"


def refuse(problems: Iterable[Problem]) -> None:
    """Raises TrainingError with the first of those that forbid training, and how many there are."""
    fatal = [p for p in problems if p.fatal]
    if fatal:
        more = f" (and {len(fatal) - 1} more)" if len(fatal) > 1 else ""
        raise TrainingError(f"{fatal[0]}{more}")
