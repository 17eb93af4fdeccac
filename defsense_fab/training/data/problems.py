"""Problems found in a dataset: what is wrong, how serious it is, and what to do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ...core.errors import TrainingError


@dataclass(frozen=True)
class Problem:
    """A problem of a dataset.

    Attributes:
        code: Stable kebab-case identifier of the kind of problem.
        is_fatal: Whether the problem forbids training.
        message: What is wrong, naming the recordings or channels concerned.
        action: One thing that the user can do about it.
        value: The measured number, in the unit that the message states; None if there is none.
        recordings: Names of the recordings concerned.
        data: Further facts for programs, such as `channel="left"`.
    """

    code: str
    is_fatal: bool
    message: str
    action: str
    value: float | None = None
    recordings: tuple[str, ...] = ()
    data: Mapping[str, object] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """The code in words, as `defsense dataset --json` writes it."""
        return self.code.replace("-", " ")

    def __str__(self) -> str:
        return f"{self.message}. {self.action}."


def raise_fatal(problems: Iterable[Problem]) -> None:
    """Raise an error for the first problem that forbids training.

    The error has the problem's code; its data are the problem's, with `count` (number of fatal
    problems), `recordings` and `value`.

    Args:
        problems: Problems of one dataset, in the order of their importance.

    Raises:
        TrainingError: If any problem is fatal.
    """
    fatal = [p for p in problems if p.is_fatal]
    if fatal:
        first = fatal[0]
        others = f" ({len(fatal) - 1} more problems forbid training)" if len(fatal) > 1 else ""
        raise TrainingError(
            f"{first.message}{others}",
            code=first.code,
            action=first.action,
            count=len(fatal),
            recordings=first.recordings,
            value=first.value,
            **first.data,
        )
