"""A build while the page is used."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from ...core.progress import Progress
from .process_work import ProcessWork


class BuildWork:
    """One build at a time. `told` hears of progress (share done, sentence) and `ended` what came of
    it: None, or what went wrong in a sentence; both on a thread of this."""

    def __init__(
        self, told: Callable[[float, str], None], ended: Callable[[str | None], None]
    ) -> None:
        self._work = ProcessWork("the build", told, lambda problem, _: ended(problem))

    @property
    def running(self) -> bool:
        """Whether there is one."""
        return self._work.running

    def start(self, folder: Path, until: str = "report") -> bool:
        """Build the device in a folder up to a stage; whether it began, which it does not while
        another one runs."""
        return self._work.start(partial(_build, folder, until))

    def cancel(self) -> None:
        """The last finished build stays, and what is done already is taken up by the next."""
        self._work.cancel()

    def close(self) -> None:
        """Cancel, and wait for it."""
        self._work.close()


def _build(folder: Path, until: str, progress: Progress) -> None:
    """In the other process."""
    from ...core.device_file import load_device
    from ...pipeline.build.build import build

    build(load_device(folder), until, progress)
