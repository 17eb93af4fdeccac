"""What is wrong with a dataset, how bad that is, and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ...core.errors import TrainingError


@dataclass(frozen=True)
class Problem:
    """Of a kind with a stable `code`, at the recordings or channels named in `what`; `fatal` where
    it forbids training; what to do as `remedy`; the `value` that was found, if it is a number, in
    the unit that `what` says; the recordings `of` which it is; more facts as `data`."""

    code: str
    fatal: bool
    what: str
    remedy: str
    value: float | None = None
    of: tuple[str, ...] = ()
    data: Mapping[str, object] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """The code in words, as `defsense dataset --json` writes it."""
        return self.code.replace("-", " ")

    def __str__(self) -> str:
        if self.what.endswith("?"):
            return f"{self.what} {self.remedy[:1].upper()}{self.remedy[1:]}"
        return f"{self.what}; {self.remedy}"


def refuse(problems: Iterable[Problem]) -> None:
    """Raises TrainingError with the first of those that forbid training, and how many there are."""
    fatal = [p for p in problems if p.fatal]
    if fatal:
        more = f" (and {len(fatal) - 1} more)" if len(fatal) > 1 else ""
        first = fatal[0]
        raise TrainingError(
            f"{first}{more}",
            code=first.code,
            count=len(fatal),
            recordings=first.of,
            value=first.value,
            **first.data,
        )
