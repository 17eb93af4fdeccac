"""A build while the page is used."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...core.device.device import Sensor
from .beside import BesideWork, Teller

_EARLY = ("body", "mesh")  # stages that need neither poses nor cords
_SHOWN = 0.1  # s between layouts that the search passes on its way


@dataclass(frozen=True)
class SeenLayout:
    """What a search has come to (see `workflow.build.stages.SearchProgress`), and for how many s it has
    worked, without pauses."""

    folder: Path
    sensors: tuple[Sensor, ...]
    rmse: float
    kept: bool
    seconds: float


class BuildWork(BesideWork):
    """One build at a time; what it finds are layouts, as SeenLayout. The last finished build stays
    where it is cancelled or fails, and what is done already is taken up by the next."""

    def __init__(
        self,
        told: Callable[[float, str], None],
        ended: Callable[[str | None], None],
        found: Callable[[SeenLayout], None] = lambda _: None,
        paused: Callable[[bool], None] = lambda _: None,
    ) -> None:
        super().__init__("build", told, ended, found, paused)

    def start(self, folder: Path, until: str = "report") -> bool:
        """Build the device in a folder up to a stage; whether it began, which it does not while
        another one runs."""
        return self.begin(_build, folder, until)


def _build(teller: Teller, folder: Path, until: str) -> None:
    """In the other process."""
    from ...core.device.device_file import load_device
    from ...workflow.build.build import build
    from ...workflow.build.stages import SearchProgress

    worked, last = _Clock(), -_SHOWN

    def progress(stage: str, share: float, message: str) -> None:
        with worked.stopped():
            teller.progress(share, f"{stage}: {message}")

    def watch(seen: SearchProgress) -> None:
        nonlocal last
        now = worked.seconds
        if seen.kept or now - last >= _SHOWN:
            last = now
            with worked.stopped():
                teller.found(SeenLayout(seen.folder, seen.sensors, seen.rmse, seen.kept, now))

    build(load_device(folder, complete=until not in _EARLY), until, progress, watch)


class _Clock:
    """The seconds since it was made, without those in which it was `stopped`."""

    def __init__(self) -> None:
        self._begun = time.monotonic()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._begun

    @contextmanager
    def stopped(self) -> Iterator[None]:
        at = time.monotonic()
        yield
        self._begun += time.monotonic() - at
