"""Long work while the page is used, of which something comes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...core.progress import Progress
from .beside import BesideWork, Teller


class ProcessWork(BesideWork):
    """One piece of work of a kind (`what`, for sentences) at a time. `told` hears of progress
    (share done, sentence) and `ended` what went wrong, in a sentence (None: nothing), and what
    came of it; both on a thread of this."""

    def __init__(
        self, what: str, told: Callable[[float, str], None],
        ended: Callable[[str | None, Any], None],
    ) -> None:  # fmt: skip
        super().__init__(what, told, self._over, self._came)
        self._told_end, self._result = ended, None

    def start(self, job: Callable[[Progress], Any]) -> bool:
        """Do `job`, which can be pickled and whose result can be, too; whether it began, which it
        does not while another one runs."""
        return self.begin(_done, job)

    def _came(self, result: Any) -> None:
        self._result = result

    def _over(self, problem: str | None) -> None:
        result, self._result = self._result, None
        self._told_end(problem, result if problem is None else None)


def _done(teller: Teller, job: Callable[[Progress], Any]) -> None:
    """In the other process."""
    teller.found(job(lambda stage, share, message: teller.progress(share, f"{stage}: {message}")))
